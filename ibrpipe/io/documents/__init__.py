"""What the JSON files that pass between stages hold: the models that write, read and describe them."""
