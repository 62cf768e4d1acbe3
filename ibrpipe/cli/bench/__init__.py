"""``ibrpipe bench``: the group, and commands that stand for themselves."""
