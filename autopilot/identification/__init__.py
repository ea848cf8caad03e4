"""From recorded runs to a model with its uncertainty."""
