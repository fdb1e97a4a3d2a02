"""What `make` runs. pythons, system, native_wheel and setup need Python 3.9 and nothing else."""
