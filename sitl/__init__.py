"""Software in the loop: the simulated boat, over the bytes a real one speaks."""
