/* Four texels filtered, where textures cannot be told to: x and y of the corner, then of the others. */
vec4 nacre_bilinear(vec2 along, vec4 corner, vec4 right, vec4 above, vec4 both)
{
  return mix(mix(corner, right, along.x), mix(above, both, along.x), along.y);
}

/* The linear colour of Y, U and V of log(1 + RGB / offset), not below 0; as models/sparse/transform.py, a
 * logarithm that shoots far over what was ever measured is cut. */
vec3 nacre_from_log(vec3 yuv, mat3 to_rgb, float offset)
{
  vec3 logarithm = to_rgb * yuv;
  return max(exp(min(logarithm, vec3(11.0 - log(offset)))) - 1.0, vec3(0.0)) * offset;
}
