/* Where a unit direction lies on a parabolic map of `size` texels (Heidrich and Seidel 1999), as
 * tables/parabolic.py, below the horizon on the rim; whole numbers and a half are texels' centres. */
vec2 nacre_parabolic_place(vec3 direction, int size)
{
  float reach = length(direction.xy);
  vec2 p = direction.xy / max(max(1.0 + direction.z, reach), 1e-6);
  return p * float(size / 2 - 1) + (float(size / 2) + 0.5);
}

/* The texel nearest to it. */
ivec2 nacre_parabolic_texel(vec3 direction, int size)
{
  return ivec2(floor(nacre_parabolic_place(direction, size)));
}
