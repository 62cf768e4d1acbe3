"""Speed against error of every renderer, and every hard case, over the registry."""
