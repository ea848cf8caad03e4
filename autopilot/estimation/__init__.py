"""From samples to the navigation state the law steers by."""
