"""One stage, one module, one ``run(inputs, config) -> outputs``."""
