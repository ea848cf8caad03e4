"""Data: vessel files and firmware parameter files. Find them with importlib.resources.files('firmware_params')."""
