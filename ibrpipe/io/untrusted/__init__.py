"""What every reader does with files that anyone may have written: bounds, places, and errors in one line."""
