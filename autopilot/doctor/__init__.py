"""What this machine and its links are good for, measured before anybody relies on them."""
