"""Pictures of a material in a scene of their own, for the command line, `verify` and the demo."""
