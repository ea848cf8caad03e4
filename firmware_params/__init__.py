"""Data: vessel files and firmware parameter files; find them with importlib.resources."""
