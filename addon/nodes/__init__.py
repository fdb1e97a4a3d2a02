"""Shader node groups that evaluate the tables, the same in EEVEE and Cycles."""
