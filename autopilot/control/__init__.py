"""Heading laws and the design of their gains."""
