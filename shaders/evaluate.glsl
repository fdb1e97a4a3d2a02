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

/* Where a point lies in one or two levels of the core, the finer first: places in texels of a layer,
 * and weights. With a map of coordinates each level has the four cells of the map round the point. */
#ifdef TABLE_COORDINATES
#  define TABLE_CELLS 4
struct TABLE_Taps {
  int count;
  vec3 taps[2 * TABLE_CELLS];
};
#else
#  define TABLE_CELLS 1
struct TABLE_Taps {
  int count;
  vec4 place;
  float coarse;
};
#endif

/* Place and weight of one tap. */
vec3 TABLE_tap(TABLE_Taps taps, int number)
{
#ifdef TABLE_COORDINATES
  return taps.taps[number];
#else
  return number == 0 ? vec3(taps.place.xy, 1.0 - taps.coarse) : vec3(taps.place.zw, taps.coarse);
#endif
}

/* uv unwrapped, in patches, and its derivatives along the screen; 0 for the finest level alone. The
 * level follows from what is unwrapped, which jumps neither where the patch repeats nor where a map
 * of coordinates does. */
TABLE_Taps TABLE_taps(vec2 uv, vec2 uv_dx, vec2 uv_dy)
{
  const vec4 regions[TABLE_LEVELS] = TABLE_REGIONS;
  vec2 size = regions[0].zw;
  float texels = max(length(uv_dx * size), length(uv_dy * size));
  float level = clamp(log2(max(texels, 1e-6)), 0.0, float(TABLE_LEVELS - 1));
  int finer = int(level);
  float coarse = level - float(finer);
  TABLE_Taps taps;
  taps.count = coarse > 0.0 ? 2 * TABLE_CELLS : TABLE_CELLS;
#ifdef TABLE_COORDINATES
  /* A level's cells are as wide as its texels. Each shows what the patch has where the map lays the
   * cell's middle, whose neighbours on the patch it is mostly laid among. */
  vec2 turn = fract(uv * size / vec2(TABLE_COORDINATES));
  for (int i = 0; i < 2 * TABLE_CELLS; i++) {
    int number = min(finer + i / TABLE_CELLS, TABLE_LEVELS - 1);
    vec4 region = regions[number];
    ivec2 cells = max(TABLE_COORDINATES >> number, ivec2(1));
    vec2 place = turn * vec2(cells) - 0.5;
    vec2 corner = floor(place);
    vec2 along = place - corner;
    ivec2 step = ivec2(i & 1, i >> 1 & 1);
    ivec2 cell = (ivec2(corner) + step + cells) % cells;
    vec2 middle = (vec2(cell) + 0.5) * vec2(TABLE_COORDINATES) / vec2(cells);
    vec2 laid = texelFetch(TABLE_coordinates, ivec3(ivec2(middle), 0), 0).xy + fract(middle);
    vec2 weight = mix(1.0 - along, along, vec2(step));
    float share = i < TABLE_CELLS ? 1.0 - coarse : coarse;
    taps.taps[i] = vec3(region.xy + fract(laid / size) * region.zw, weight.x * weight.y * share);
  }
#else
  vec2 inside = fract(uv);
  vec4 first = regions[finer];
  vec4 second = regions[min(finer + 1, TABLE_LEVELS - 1)];
  taps.coarse = coarse;
  taps.place.xy = first.xy + inside * first.zw;
  taps.place.zw = second.xy + inside * second.zw;
#endif
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

/* The core of a light's clusters with the view contracted. The loop over taps is the outermost, as
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
    vec3 tap = TABLE_tap(point.taps, t);
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
          sum.x += dot(TABLE_core_quad(first, tap.xy), row);
          if (4 * quad + 1 < TABLE_R_LIGHT) {
            sum.y += dot(TABLE_core_quad(first + TABLE_VIEW_QUADS, tap.xy), row);
          }
          if (4 * quad + 2 < TABLE_R_LIGHT) {
            sum.z += dot(TABLE_core_quad(first + 2 * TABLE_VIEW_QUADS, tap.xy), row);
          }
          if (4 * quad + 3 < TABLE_R_LIGHT) {
            sum.w += dot(TABLE_core_quad(first + 3 * TABLE_VIEW_QUADS, tap.xy), row);
          }
        }
        reduced.ranks[set + quad] += tap.z * sum;
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

#  ifdef TABLE_WORLD

/* The radiance under a world (tables/environment.py): its light vectors stand where a light's rows do,
 * with all clusters of lights, as many at a time as one light mixes. The frame's columns are tangent,
 * bitangent and normal in the world that the vectors were made for. */
vec3 TABLE_from_world(TABLE_Point point, mat3 frame)
{
  NacreCorners around = nacre_corners(frame, TABLE_WORLD);
  vec3 value = vec3(0.0);
  int done = 0;
  do {
    int first = min(done, TABLE_C_LIGHT - TABLE_K_LIGHT);
#    if TABLE_C_LIGHT > 1
    int clusters[TABLE_K_LIGHT];
    for (int k = 0; k < TABLE_K_LIGHT; k++) {
      clusters[k] = first + k;
    }
    TABLE_Reduced reduced = TABLE_contract_view(point, clusters);
#    else
    TABLE_Reduced reduced = point.reduced;
#    endif
    for (int i = 0; i < TABLE_K_LIGHT * TABLE_SETS; i++) {
      int cluster = first + i / TABLE_SETS;
      if (cluster < done) {
        continue;
      }
#    if TABLE_LIGHT_OWNERS > 1
      int owner = cluster * TABLE_LIGHT_OWNERS + point.clusters[i % TABLE_SETS];
#    else
      int owner = cluster;
#    endif
      for (int channel = 0; channel < TABLE_WORLD_CHANNELS; channel++) {
        int layer = (owner * TABLE_WORLD_CHANNELS + channel) * TABLE_LIGHT_QUADS;
        for (int quad = 0; quad < TABLE_LIGHT_QUADS; quad++) {
          vec4 row = vec4(0.0);
          for (int corner = 0; corner < 4; corner++) {
            ivec3 at = ivec3(around.texels[corner], layer + quad);
            row += around.weights[corner] * texelFetch(TABLE_world, at, 0);
          }
          value[channel] += dot(row, reduced.ranks[i * TABLE_LIGHT_QUADS + quad]);
        }
      }
    }
    done = first + TABLE_K_LIGHT;
  } while (done < TABLE_C_LIGHT);
#    if TABLE_WORLD_CHANNELS == 1
  value = value.xxx;
#    endif
  return max(value * TABLE_world_scale, 0.0);
}

#  endif

#else

/* Occlusion: the reduced vector's one number, a mask or a signed distance. */
float TABLE_occlusion(TABLE_Point point)
{
  return point.reduced.ranks[0].x * TABLE_scale;
}

#endif
