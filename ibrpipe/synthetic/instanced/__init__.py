"""Seeded scenes of many copies: trees and forests, a city, solid walls."""
