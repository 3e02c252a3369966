"""Known failures of temporal methods and extreme inputs, in small ray-cast scenes with exact references."""
