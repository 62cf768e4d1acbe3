"""Assets as one self-contained web page: samples, patches and view dependence packed for the scripts that draw them."""
