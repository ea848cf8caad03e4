"""NMEA 2000: a bus by python-can or through a gateway; frames, fields, samples, the node, and the link."""
