/* The texel nearest to a unit direction on a parabolic map of `size` texels (Heidrich and Seidel
 * 1999), as tables/parabolic.py; below the horizon the rim's. */
ivec2 nacre_parabolic_texel(vec3 direction, int size)
{
  float reach = length(direction.xy);
  vec2 p = direction.xy / max(max(1.0 + direction.z, reach), 1e-6);
  return ivec2(floor(p * float(size / 2 - 1) + (float(size / 2) + 0.5)));
}
