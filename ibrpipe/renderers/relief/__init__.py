"""The `relief` renderer: height fields and relief-mapped meshes, ray by ray (policarpo2005)."""
