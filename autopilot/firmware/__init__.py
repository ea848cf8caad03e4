"""A flight controller's parameters: files, the MAVLink parameter protocol, upload and the way back."""
