"""Ray marching of height fields (policarpo2005)."""
