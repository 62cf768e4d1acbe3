"""Scenes on disk: scene folders of our own, and glTF files with their hierarchy kept."""

from ibrpipe.io.scenes.read import is_scene, read_scene
from ibrpipe.io.scenes.write import write_scene

__all__ = ["is_scene", "read_scene", "write_scene"]
