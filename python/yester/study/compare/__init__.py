"""Methods, components and buffers, measured against references and drawn."""
