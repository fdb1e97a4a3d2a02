/* The engine's surfaces: a model's value under every light, or a plain diffuser. What is read before
 * it: shadows.glsl, and evaluate.glsl printed as BTF and as OCCLUSION where a material has them. */

/* Directions of the tangent frame as the node group "Nacre Frame": the tangent upright on the shading
 * normal, the bitangent on the side of +v, the normal towards the viewer. */
mat3 nacre_frame(vec3 towards_viewer)
{
  vec3 normal = normalize(nacre_normal);
  vec3 tangent = nacre_tangent.xyz - normal * dot(normal, nacre_tangent.xyz);
  if (dot(tangent, tangent) < 1e-12) { /* no UV map */
    tangent = cross(abs(normal.z) < 0.9 ? vec3(0, 0, 1) : vec3(1, 0, 0), normal);
  }
  tangent = normalize(tangent);
  vec3 bitangent = cross(normal, tangent) * (nacre_tangent.w < 0.0 ? -1.0 : 1.0);
  return mat3(tangent, bitangent, dot(normal, towards_viewer) < 0.0 ? -normal : normal);
}

/* Direction to a light, and the radiance of a white perfect diffuser that it lights head-on. */
vec3 nacre_light_at(NacreLight light, vec3 position, out vec3 radiance)
{
  radiance = light.radiance.rgb;
  if (light.position.w == NACRE_SUN) {
    return light.axis.xyz;
  }
  vec3 towards = light.position.xyz - position;
  float square = max(dot(towards, towards), 1e-12);
  vec3 direction = towards * inversesqrt(square);
  radiance /= square;
  float cosine = dot(direction, light.axis.xyz);
  if (light.position.w == NACRE_SPOT) {
    float t = clamp((cosine - light.cone.x) / light.cone.y, 0.0, 1.0);
    radiance *= t * t * (3.0 - 2.0 * t);
  }
  if (light.position.w == NACRE_AREA) {
    radiance *= max(cosine, 0.0);
  }
  return direction;
}

void main()
{
  /* Derivatives first, where all pixels still go the same way. */
  vec2 uv = nacre_uv * nacre_material.repeat.xy;
  vec2 uv_dx = dFdx(uv);
  vec2 uv_dy = dFdy(uv);
  vec3 facing = cross(dFdx(nacre_position), dFdy(nacre_position));
  vec3 towards_viewer = normalize(nacre_camera.camera.xyz - nacre_position * nacre_camera.camera.w);
  if (dot(facing, towards_viewer) < 0.0) {
    facing = -facing;
  }
  mat3 frame = nacre_frame(facing);
  vec3 view = towards_viewer * frame;

  float alpha = 1.0;
#ifdef NACRE_OCCLUSION /* Eq. 26: threshold and weight */
  float distance = OCCLUSION_occlusion(OCCLUSION_prepare(view, uv, uv_dx, uv_dy));
  alpha = distance >= nacre_visibility.x ? 1.0 : clamp(nacre_visibility.y * distance, 0.0, 1.0);
#  ifdef NACRE_DEPTH /* a light's view: it gets through where less than half is covered */
  if (alpha < 0.5) {
    discard;
  }
#  else
  /* The first pass draws what is fully visible, the second blends the rest against its depth. */
  if (nacre_visibility.z == 0.0 ? alpha < 1.0 : (alpha >= 1.0 || alpha <= 0.0)) {
    discard;
  }
#  endif
#endif

#ifndef NACRE_DEPTH
  vec3 shade = vec3(0.0);
#  ifdef NACRE_BTF
  BTF_Point point = BTF_prepare(view, uv, uv_dx, uv_dy);
#  else
  vec3 base = nacre_material.base.rgb;
  if (nacre_material.base.a > 0.0) { /* a model that could not be read */
    vec3 cell = floor(nacre_position * nacre_material.base.a);
    base *= mod(cell.x + cell.y + cell.z, 2.0) < 0.5 ? 1.0 : 0.6;
  }
  shade = base * nacre_camera.world.rgb;
#  endif
  int count = int(nacre_lights.count.x);
  int i = 0;
  do { /* asks at its end, as evaluate.glsl explains; a light of a scene without any is black */
    vec3 radiance;
    NacreLight lamp = nacre_lights.light[i];
    vec3 direction = nacre_light_at(lamp, nacre_position, radiance);
    vec3 light = direction * frame;
#  ifdef NACRE_SHADOWS
    if (lamp.axis.w >= 0.0) {
      radiance *= nacre_shadow(lamp, nacre_position, frame[2]);
    }
#  endif
#  ifdef NACRE_BTF
    shade += radiance * BTF_value(point, light);
#  else
    shade += radiance * base * max(light.z, 0.0);
#  endif
    i++;
  } while (i < count);
#  ifdef BTF_WORLD
  shade += BTF_from_world(point, mat3(nacre_material.turn) * frame);
#  endif
  nacre_colour = vec4(shade * alpha, alpha);
#endif
}
