"""Rudder drives on serial lines of their own: what they speak, without the line itself."""
