"""Command line: glue between click and the stages."""
