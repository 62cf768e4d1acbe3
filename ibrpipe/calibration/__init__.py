"""Cameras from photos: what the calibrate stage consists of.

`photos` finds the photos and what is known of their lenses, `job` says what is to be done, `child` runs it in a process
of its own (`worker` is what runs there), `results` turns the outcome into files and words.
"""
