"""Materials built by script and measured with Cycles: data for tests of the models."""
