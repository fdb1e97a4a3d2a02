"""A job for a process of its own, which has to import this file: so nothing else is imported."""


def fill(megabytes):
    return len(b"1" * (megabytes << 20))
