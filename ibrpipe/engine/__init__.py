"""Running stages: pipeline files, run folders, artifacts, executor, provenance."""
