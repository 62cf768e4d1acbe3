"""Kernels of the compact form of layers: prediction of whole numbers along a picture with holes."""
