"""Small captures with exact truth, made from closed-form shading on ray-cast geometry."""
