"""Bytes in, typed samples out; and back."""
