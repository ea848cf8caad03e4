"""Recordings of any program, read strictly into series of quantities, merged, and laid out as a table."""
