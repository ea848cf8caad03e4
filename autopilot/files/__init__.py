"""Files and texts from outside: read strictly, written wholly or not at all."""
