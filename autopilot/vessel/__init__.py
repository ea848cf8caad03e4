"""The vessel file: its schema, the file itself, and its numbers as MAVLink parameters."""
