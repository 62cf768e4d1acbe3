"""How finely an asset is coded: steps from exact to coarse, and the choice of one by measuring."""
