"""A flight controller over MAVLink: codec, signing, the companion session and what it is made of."""
