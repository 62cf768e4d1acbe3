"""Assets as ordinary triangle meshes with an atlas of colours, for glTF, OBJ and PLY."""
