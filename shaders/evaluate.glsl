/* The tables of a clustered Tucker model evaluated at one point (K-CTA, Section 6.3.3; MK-CTA,
 * Section 5.1). Printed once for each set of tables that a shader reads: TABLE becomes the set's
 * name, and its sizes are constants TABLE_..., so that every loop has a known length. Only nonzeros
 * are fetched: K_n rows of R_n ranks, four ranks to a texel.
 *
 *   value[channel] = sum over k_l, k_v, r_l, r_v of
 *     light[o(c_v), channel, k_l, r_l] * view[o(c_l), k_v, r_v] * core[c_l, c_v, r_l, r_v]
 *
 * Order of the loops: the view's rows are the innermost factor and are read before, then each core
 * texel is one fetch and one dot product, and four of them make a quad of the light's ranks.
 */

#define TABLE_BLOCKS (TABLE_R_LIGHT * TABLE_VIEW_QUADS)

/* Clusters of the direction at a texel of the parabolic map; 0 where a mode is not clustered. */
void TABLE_view_clusters(ivec2 texel, out int clusters[TABLE_K_VIEW])
{
#if TABLE_C_VIEW > 1
  for (int quad = 0; quad < (TABLE_K_VIEW + 3) / 4; quad++) {
    vec4 found = texelFetch(TABLE_view_index, ivec3(texel, quad), 0);
    for (int k = 4 * quad; k < min(4 * quad + 4, TABLE_K_VIEW); k++) {
      clusters[k] = int(found[k - 4 * quad]);
    }
  }
#else
  for (int k = 0; k < TABLE_K_VIEW; k++) {
    clusters[k] = 0;
  }
#endif
}

void TABLE_light_clusters(ivec2 texel, out int clusters[TABLE_K_LIGHT])
{
#if TABLE_C_LIGHT > 1
  for (int quad = 0; quad < (TABLE_K_LIGHT + 3) / 4; quad++) {
    vec4 found = texelFetch(TABLE_light_index, ivec3(texel, quad), 0);
    for (int k = 4 * quad; k < min(4 * quad + 4, TABLE_K_LIGHT); k++) {
      clusters[k] = int(found[k - 4 * quad]);
    }
  }
#else
  for (int k = 0; k < TABLE_K_LIGHT; k++) {
    clusters[k] = 0;
  }
#endif
}

/* One quad of the core, filtered: `place` in texels of the layer. */
vec4 TABLE_core_quad(int block, vec2 place)
{
#if TABLE_CORE_TILES > 1 /* more blocks than a texture has layers */
  place.x += float((block % TABLE_CORE_TILES) * TABLE_CORE_PITCH);
  block /= TABLE_CORE_TILES;
#endif
#ifdef NACRE_HARDWARE_FILTER
  return textureLod(TABLE_core, vec3(place * TABLE_CORE_STEP, float(block)), 0.0);
#else
  vec2 corner = floor(place - 0.5);
  vec2 along = place - 0.5 - corner;
  ivec3 at = ivec3(corner, block);
  return mix(mix(texelFetch(TABLE_core, at, 0),
                 texelFetch(TABLE_core, at + ivec3(1, 0, 0), 0),
                 along.x),
             mix(texelFetch(TABLE_core, at + ivec3(0, 1, 0), 0),
                 texelFetch(TABLE_core, at + ivec3(1, 1, 0), 0),
                 along.x),
             along.y);
#endif
}

vec4 TABLE_view_quad(int c_light, int k_view, int quad, ivec2 texel)
{
#if TABLE_VIEW_OWNERS == 1
  c_light = 0;
#endif
  int layer = (c_light * TABLE_K_VIEW + k_view) * TABLE_VIEW_QUADS + quad;
  return texelFetch(TABLE_view, ivec3(texel, layer), 0);
}

/* Where a point lies in one or two levels of the core. */
struct TABLE_Taps {
  int count;
  vec2 place[2];
  float weight[2];
};

/* uv unwrapped, in patches, and its derivatives along the screen; 0 for the finest level alone.
 *
 * A map of coordinates (texture synthesis) belongs in front of this: it replaces uv by where the
 * pixel lies on the patch, and keeps the derivatives of the unwrapped uv. */
TABLE_Taps TABLE_taps(vec2 uv, vec2 uv_dx, vec2 uv_dy)
{
  const vec4 regions[TABLE_LEVELS] = TABLE_REGIONS;
  vec2 size = regions[0].zw;
  float texels = max(length(uv_dx * size), length(uv_dy * size));
  float level = clamp(log2(max(texels, 1e-6)), 0.0, float(TABLE_LEVELS - 1));
  int finer = int(level);
  float coarse = level - float(finer);
  vec2 inside = fract(uv);
  TABLE_Taps taps;
  taps.count = coarse > 0.0 ? 2 : 1;
  for (int i = 0; i < 2; i++) {
    vec4 region = regions[min(finer + i, TABLE_LEVELS - 1)];
    taps.place[i] = region.xy + inside * region.zw;
    taps.weight[i] = i == 0 ? 1.0 - coarse : coarse;
  }
  return taps;
}

/* The core of a pair of clusters with the view contracted: the light's ranks 4 quad to 4 quad + 3. */
vec4 TABLE_contract_view(
    int c_light, int c_view, int quad, vec4 rows[TABLE_VIEW_QUADS], TABLE_Taps taps)
{
  int block = (c_light * TABLE_C_VIEW + c_view) * TABLE_BLOCKS + 4 * quad * TABLE_VIEW_QUADS;
  vec4 reduced = vec4(0.0);
  for (int t = 0; t < taps.count; t++) {
    vec4 level = vec4(0.0);
    for (int q = 0; q < TABLE_VIEW_QUADS; q++) {
      level.x += dot(TABLE_core_quad(block + q, taps.place[t]), rows[q]);
      if (4 * quad + 1 < TABLE_R_LIGHT) {
        level.y += dot(TABLE_core_quad(block + TABLE_VIEW_QUADS + q, taps.place[t]), rows[q]);
      }
      if (4 * quad + 2 < TABLE_R_LIGHT) {
        level.z += dot(TABLE_core_quad(block + 2 * TABLE_VIEW_QUADS + q, taps.place[t]), rows[q]);
      }
      if (4 * quad + 3 < TABLE_R_LIGHT) {
        level.w += dot(TABLE_core_quad(block + 3 * TABLE_VIEW_QUADS + q, taps.place[t]), rows[q]);
      }
    }
    reduced += taps.weight[t] * level;
  }
  return reduced;
}

/* What one view and one place have in common for all lights. Where lights are not clustered that is
 * the reduced vector itself: once, or once for each mixture whose clusters have their own light rows.
 */
#if TABLE_C_LIGHT == 1
#  define TABLE_SETS (TABLE_LIGHT_OWNERS > 1 ? TABLE_K_VIEW : 1)
#endif

struct TABLE_Point {
  TABLE_Taps taps;
  ivec2 view;
  int clusters[TABLE_K_VIEW];
#if TABLE_C_LIGHT == 1
  vec4 reduced[TABLE_SETS * TABLE_LIGHT_QUADS];
#endif
};

TABLE_Point TABLE_prepare(vec3 view, vec2 uv, vec2 uv_dx, vec2 uv_dy)
{
  TABLE_Point point;
  point.taps = TABLE_taps(uv, uv_dx, uv_dy);
  point.view = nacre_parabolic_texel(view, TABLE_MAP);
  TABLE_view_clusters(point.view, point.clusters);
#if TABLE_C_LIGHT == 1
  for (int i = 0; i < TABLE_SETS * TABLE_LIGHT_QUADS; i++) {
    point.reduced[i] = vec4(0.0);
  }
  for (int k = 0; k < TABLE_K_VIEW; k++) {
    vec4 rows[TABLE_VIEW_QUADS];
    for (int q = 0; q < TABLE_VIEW_QUADS; q++) {
      rows[q] = TABLE_view_quad(0, k, q, point.view);
    }
    int set = TABLE_SETS > 1 ? k : 0;
    for (int quad = 0; quad < TABLE_LIGHT_QUADS; quad++) {
      point.reduced[set * TABLE_LIGHT_QUADS + quad] += TABLE_contract_view(
          0, point.clusters[k], quad, rows, point.taps);
    }
  }
#endif
  return point;
}

#ifdef TABLE_LIGHT

vec4 TABLE_light_quad(int c_view, int channel, int k_light, int quad, ivec2 texel)
{
#  if TABLE_LIGHT_OWNERS == 1
  c_view = 0;
#  endif
  int layer = ((c_view * TABLE_CHANNELS + channel) * TABLE_K_LIGHT + k_light) * TABLE_LIGHT_QUADS;
  return texelFetch(TABLE_light, ivec3(texel, layer + quad), 0);
}

/* The value for one light in the tangent frame, each channel not below 0. */
vec3 TABLE_value(TABLE_Point point, vec3 light)
{
  vec3 value = vec3(0.0);
  ivec2 texel = nacre_parabolic_texel(light, TABLE_MAP);
#  if TABLE_C_LIGHT == 1
  for (int set = 0; set < TABLE_SETS; set++) {
    for (int quad = 0; quad < TABLE_LIGHT_QUADS; quad++) {
      vec4 reduced = point.reduced[set * TABLE_LIGHT_QUADS + quad];
      for (int channel = 0; channel < TABLE_CHANNELS; channel++) {
        value[channel] += dot(
            TABLE_light_quad(point.clusters[set], channel, 0, quad, texel), reduced);
      }
    }
  }
#  else
  int clusters[TABLE_K_LIGHT];
  TABLE_light_clusters(texel, clusters);
  for (int kl = 0; kl < TABLE_K_LIGHT; kl++) {
    for (int kv = 0; kv < TABLE_K_VIEW; kv++) {
      vec4 rows[TABLE_VIEW_QUADS];
      for (int q = 0; q < TABLE_VIEW_QUADS; q++) {
        rows[q] = TABLE_view_quad(clusters[kl], kv, q, point.view);
      }
      for (int quad = 0; quad < TABLE_LIGHT_QUADS; quad++) {
        vec4 reduced = TABLE_contract_view(
            clusters[kl], point.clusters[kv], quad, rows, point.taps);
        for (int channel = 0; channel < TABLE_CHANNELS; channel++) {
          value[channel] += dot(
              TABLE_light_quad(point.clusters[kv], channel, kl, quad, texel), reduced);
        }
      }
    }
  }
#  endif
#  if TABLE_CHANNELS == 1
  value = value.xxx;
#  endif
  return light.z > 0.0 ? max(value * TABLE_scale, 0.0) : vec3(0.0);
}

/* The environment belongs here: its light is the same sum with the light rows of all directions
 * added up by an environment map, R_light numbers for each channel (and for each cluster of the
 * light and owner of its rows) looked up by the orientation of the frame, in place of
 * TABLE_light_quad. */

#else

/* Occlusion: the reduced vector's one number, a mask or a signed distance. */
float TABLE_occlusion(TABLE_Point point)
{
  return point.reduced[0].x * TABLE_scale;
}

#endif
