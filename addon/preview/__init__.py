"""Nacre's render engine: tables drawn from texture arrays with GLSL, for the viewport and F12."""
