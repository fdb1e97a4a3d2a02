/* The share of a light that reaches a position, from depth maps; 2 x 2 texels are mixed.
 *
 * A light's layers begin at axis.w: one for a sun, a spot and a sample of an area, six for a point,
 * in the order +x -x +y -y +z -z. The position is moved along the normal by the width of a texel,
 * so that a surface does not shadow itself. */
float nacre_shadow(NacreLight light, vec3 position, vec3 normal)
{
  int layer = int(light.axis.w);
  vec3 from = position - light.position.xyz;
  float width = light.cone.w * (light.position.w == NACRE_SUN ? 1.0 : length(from));
  if (light.position.w == NACRE_POINT) {
    vec3 size = abs(from);
    if (size.x >= max(size.y, size.z)) {
      layer += from.x > 0.0 ? 0 : 1;
    }
    else if (size.y >= size.z) {
      layer += from.y > 0.0 ? 2 : 3;
    }
    else {
      layer += from.z > 0.0 ? 4 : 5;
    }
  }
  vec4 seen = nacre_shadow_views[layer].projection * vec4(position + normal * (1.5 * width), 1.0);
  vec3 place = seen.xyz / seen.w * 0.5 + 0.5;
  if (seen.w <= 0.0 || any(lessThan(place, vec3(0.0))) || any(greaterThan(place, vec3(1.0)))) {
    return 1.0;
  }
  vec2 texel = place.xy * float(NACRE_SHADOW_SIZE) - 0.5;
  vec2 along = fract(texel);
  ivec2 corner = ivec2(floor(texel));
  vec4 lit;
  for (int i = 0; i < 4; i++) {
    ivec2 at = clamp(corner + ivec2(i & 1, i >> 1), ivec2(0), ivec2(NACRE_SHADOW_SIZE - 1));
    lit[i] = texelFetch(nacre_shadow_maps, ivec3(at, layer), 0).r + 1e-5 < place.z ? 0.0 : 1.0;
  }
  return mix(mix(lit.x, lit.y, along.x), mix(lit.z, lit.w, along.x), along.y);
}
