"""Diffuse texels under shared tables of reflected light: directions, the model, its gradients, and drawing."""
