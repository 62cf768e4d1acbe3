"""From depth maps and masks to a surface that says how sure it is."""
