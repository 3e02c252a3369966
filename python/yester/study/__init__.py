"""The measuring half: metrics, scenes and the demo. Nothing above imports it."""
