"""From a mesh and photos to what is stored: plans, layers, diffuse colour, view dependence."""
