"""From orders to references the rudder can follow."""
