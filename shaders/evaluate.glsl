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

/* Clusters of the direction at a texel of the parabolic map; 0 where the view is not clustered. */
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

#if TABLE_C_LIGHT > 1
void TABLE_light_clusters(ivec2 texel, out int clusters[TABLE_K_LIGHT])
{
  for (int quad = 0; quad < (TABLE_K_LIGHT + 3) / 4; quad++) {
    vec4 found = texelFetch(TABLE_light_index, ivec3(texel, quad), 0);
    for (int k = 4 * quad; k < min(4 * quad + 4, TABLE_K_LIGHT); k++) {
      clusters[k] = int(found[k - 4 * quad]);
    }
  }
}
#endif

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

/* Where a point lies in one or two levels of the core: places in texels of a layer, the finer first,
 * and the coarser one's weight. */
struct TABLE_Taps {
  int count;
  vec4 place;
  float coarse;
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
  vec2 inside = fract(uv);
  vec4 first = regions[finer];
  vec4 second = regions[min(finer + 1, TABLE_LEVELS - 1)];
  TABLE_Taps taps;
  taps.coarse = level - float(finer);
  taps.count = taps.coarse > 0.0 ? 2 : 1;
  taps.place.xy = first.xy + inside * first.zw;
  taps.place.zw = second.xy + inside * second.zw;
  return taps;
}

/* Reduced vectors: one for all mixtures of the view where its clusters share the light's rows, else
 * one for each. */
#define TABLE_SETS (TABLE_LIGHT_OWNERS > 1 ? TABLE_K_VIEW : 1)

struct TABLE_Reduced {
  vec4 ranks[TABLE_K_LIGHT * TABLE_SETS * TABLE_LIGHT_QUADS];
};

struct TABLE_Point {
  TABLE_Taps taps;
  ivec2 view;
  int clusters[TABLE_K_VIEW];
#if TABLE_C_LIGHT == 1
  TABLE_Reduced reduced;
#endif
};

/* The core of a light's clusters with the view contracted. The loop over levels is the outermost, as
 * the only one whose length is not known to the compiler, and asks at its end: where pixels run side
 * by side with masks (Mesa's llvmpipe), asking first costs one more round. */
TABLE_Reduced TABLE_contract_view(TABLE_Point point, int lights[TABLE_K_LIGHT])
{
  vec4 rows[TABLE_K_LIGHT * TABLE_K_VIEW * TABLE_VIEW_QUADS];
  for (int i = 0; i < TABLE_K_LIGHT * TABLE_K_VIEW; i++) {
    for (int q = 0; q < TABLE_VIEW_QUADS; q++) {
      int owner = lights[i / TABLE_K_VIEW];
      rows[i * TABLE_VIEW_QUADS + q] = TABLE_view_quad(owner, i % TABLE_K_VIEW, q, point.view);
    }
  }
  TABLE_Reduced reduced;
  for (int i = 0; i < TABLE_K_LIGHT * TABLE_SETS * TABLE_LIGHT_QUADS; i++) {
    reduced.ranks[i] = vec4(0.0);
  }
  int t = 0;
  do {
    vec2 place = t == 0 ? point.taps.place.xy : point.taps.place.zw;
    float weight = t == 0 ? 1.0 - point.taps.coarse : point.taps.coarse;
    for (int i = 0; i < TABLE_K_LIGHT * TABLE_K_VIEW; i++) {
      int kl = i / TABLE_K_VIEW;
      int kv = i % TABLE_K_VIEW;
      int block = (lights[kl] * TABLE_C_VIEW + point.clusters[kv]) * TABLE_BLOCKS;
      int set = (kl * TABLE_SETS + (TABLE_SETS > 1 ? kv : 0)) * TABLE_LIGHT_QUADS;
      for (int quad = 0; quad < TABLE_LIGHT_QUADS; quad++) {
        vec4 sum = vec4(0.0);
        for (int q = 0; q < TABLE_VIEW_QUADS; q++) {
          vec4 row = rows[i * TABLE_VIEW_QUADS + q];
          int first = block + 4 * quad * TABLE_VIEW_QUADS + q;
          sum.x += dot(TABLE_core_quad(first, place), row);
          if (4 * quad + 1 < TABLE_R_LIGHT) {
            sum.y += dot(TABLE_core_quad(first + TABLE_VIEW_QUADS, place), row);
          }
          if (4 * quad + 2 < TABLE_R_LIGHT) {
            sum.z += dot(TABLE_core_quad(first + 2 * TABLE_VIEW_QUADS, place), row);
          }
          if (4 * quad + 3 < TABLE_R_LIGHT) {
            sum.w += dot(TABLE_core_quad(first + 3 * TABLE_VIEW_QUADS, place), row);
          }
        }
        reduced.ranks[set + quad] += weight * sum;
      }
    }
    t++;
  } while (t < point.taps.count);
  return reduced;
}

/* What one view and one place have in common for all lights: where lights are not clustered, the
 * reduced vector itself. */
TABLE_Point TABLE_prepare(vec3 view, vec2 uv, vec2 uv_dx, vec2 uv_dy)
{
  TABLE_Point point;
  point.taps = TABLE_taps(uv, uv_dx, uv_dy);
  point.view = nacre_parabolic_texel(view, TABLE_MAP);
  TABLE_view_clusters(point.view, point.clusters);
#if TABLE_C_LIGHT == 1
  int lights[TABLE_K_LIGHT];
  for (int k = 0; k < TABLE_K_LIGHT; k++) {
    lights[k] = 0;
  }
  point.reduced = TABLE_contract_view(point, lights);
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
#  if TABLE_C_LIGHT > 1
  int clusters[TABLE_K_LIGHT];
  TABLE_light_clusters(texel, clusters);
  TABLE_Reduced reduced = TABLE_contract_view(point, clusters);
#  else
  TABLE_Reduced reduced = point.reduced;
#  endif
  for (int i = 0; i < TABLE_K_LIGHT * TABLE_SETS; i++) {
    int owner = point.clusters[i % TABLE_SETS];
    for (int quad = 0; quad < TABLE_LIGHT_QUADS; quad++) {
      vec4 ranks = reduced.ranks[i * TABLE_LIGHT_QUADS + quad];
      for (int channel = 0; channel < TABLE_CHANNELS; channel++) {
        value[channel] += dot(
            TABLE_light_quad(owner, channel, i / TABLE_SETS, quad, texel), ranks);
      }
    }
  }
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
  return point.reduced.ranks[0].x * TABLE_scale;
}

#endif
