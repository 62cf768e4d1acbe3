"""Relief-mapped triangle meshes (policarpo2005)."""
