"""SparseBTF: dictionaries trained once, and sparse codes of any material of the same directions.

Kavoosighafi, Frisvad, Hajisharif, Unger and Miandji 2023.
"""
