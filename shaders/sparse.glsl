/* The tables of a sparse model evaluated at one point (SparseBTF, Eqs. 5 and 6), laid out by
 * tables/sparse_layout.py. Printed once for each set of tables, with the functions of evaluate.glsl.
 *
 *   part = sum over the patch's coefficients of value * texels[t] * light[l] * view[v]
 *
 * for Y, U and V, then part * deviation + mean, all of the logarithm of a colour; of a blend the sum
 * over its materials by their weights (Section 3.5), before the logarithm is undone. Rows are read
 * between the measured directions from filtered maps, so a light costs what a measured one would.
 * The loops are as long as the lists of the patch, and ask at their ends, as evaluate.glsl explains.
 */

#ifdef NACRE_HARDWARE_FILTER
#  define TABLE_FILTERED(map, place, layer) \
    textureLod(map, vec3((place) / vec2(textureSize(map, 0).xy), layer), 0.0)
#else
#  define TABLE_FILTERED(map, place, layer) \
    nacre_bilinear(fract((place) - 0.5), \
                   texelFetch(map, ivec3(floor((place) - 0.5), layer), 0), \
                   texelFetch(map, ivec3(floor((place) + vec2(0.5, -0.5)), layer), 0), \
                   texelFetch(map, ivec3(floor((place) + vec2(-0.5, 0.5)), layer), 0), \
                   texelFetch(map, ivec3(floor((place) + 0.5), layer), 0))
#endif

#ifndef TABLE_MEASURED /* benchmarks/_image_space.py reads rows of measured directions */

/* Where a direction is on the maps, and quads of rows there. */
vec2 TABLE_direction(vec3 direction)
{
  return nacre_parabolic_place(direction, TABLE_MAP);
}

vec4 TABLE_light_quad(int quad, vec2 place)
{
#if TABLE_LIGHT_TILES > 1 /* more quads than a texture has layers */
  place.x += float((quad % TABLE_LIGHT_TILES) * TABLE_MAP);
  quad /= TABLE_LIGHT_TILES;
#endif
  return TABLE_FILTERED(TABLE_light, place, quad);
}

vec4 TABLE_view_quad(int quad, vec2 place)
{
#if TABLE_VIEW_TILES > 1
  place.x += float((quad % TABLE_VIEW_TILES) * TABLE_MAP);
  quad /= TABLE_VIEW_TILES;
#endif
  return TABLE_FILTERED(TABLE_view, place, quad);
}

#endif

/* Where a point lies: a patch or a coarser one, by its place in the textures, and its texel in two
 * levels of it, the finer first. */
struct TABLE_Place {
  ivec2 patch_;
  ivec2 texels;
  float coarse;
};

/* uv unwrapped, in material repeats, and its derivatives along the screen. The level follows from
 * what is unwrapped, which does not jump where the material repeats. Levels of a patch are mixed; of
 * coarser patches the nearest is taken, as each has coefficients of its own. */
TABLE_Place TABLE_place(vec2 uv, vec2 uv_dx, vec2 uv_dy)
{
  const ivec3 levels[TABLE_LEVELS] = TABLE_SIZES; /* width, height, first texel */
  const ivec3 patches[TABLE_PATCH_LEVELS] = TABLE_PATCHES; /* across, up, first patch */
  const vec2 size = TABLE_SIZE;
  float texels = max(length(uv_dx * size), length(uv_dy * size));
  float level = max(log2(max(texels, 1e-6)), 0.0);
  int coarser = clamp(int(level + 1.5) - TABLE_LEVELS, 0, TABLE_PATCH_LEVELS - 1);
  level = coarser > 0 ? float(TABLE_LEVELS - 1) : min(level, float(TABLE_LEVELS - 1));
  int finer = int(level);
#ifdef TABLE_COORDINATES
  /* A level's cells are as wide as its texels, and show what the map lays at their middle. */
  ivec2 cells = max(TABLE_COORDINATES >> (finer + coarser), ivec2(1));
  vec2 cell = min(floor(fract(uv * size / vec2(TABLE_COORDINATES)) * vec2(cells)), vec2(cells - 1));
  vec2 middle = (cell + 0.5) * vec2(TABLE_COORDINATES) / vec2(cells);
  vec2 texel = texelFetch(TABLE_coordinates, ivec3(ivec2(middle), 0), 0).xy + fract(middle);
#else
  vec2 texel = fract(uv) * size;
#endif
  texel = min(texel, size - 0.5);
  ivec3 grid = patches[coarser];
  vec2 turn = coarser > 0 ? texel / size * vec2(grid.xy) : texel / vec2(levels[0].xy);
  ivec2 cell_ = min(ivec2(turn), grid.xy - 1);
  int number = grid.z + cell_.y * grid.x + cell_.x;
  TABLE_Place place;
  place.patch_ = ivec2(number % patches[0].x, number / patches[0].x);
  for (int i = 0; i < 2; i++) {
    ivec3 own = levels[min(finer + i, TABLE_LEVELS - 1)];
    ivec2 at = min(ivec2((turn - vec2(cell_)) * vec2(own.xy)), own.xy - 1);
    place.texels[i] = own.z + at.y * own.x + at.x;
  }
  place.coarse = level - float(finer);
  return place;
}

vec4 TABLE_list(ivec2 patch_, int column)
{
  return texelFetch(TABLE_lists, ivec3(column, patch_), 0);
}

/* What one view and one place have in common for all lights: the quads of light rows that each part
 * sums up to its end, the sums by row, and the images' mean and deviation as their products stand. */
struct TABLE_Point {
  vec4 weights;
  int ends[3 * TABLE_MATERIALS];
  int quads[TABLE_LIGHT_QUADS];
  float reduced[4 * TABLE_LIGHT_QUADS];
  vec4 images[TABLE_IMAGES];
};

vec4 TABLE_weights_at(TABLE_Place at)
{
#if TABLE_MATERIALS == 1
  return vec4(1.0);
#elif defined(TABLE_MASKS)
  vec4 finer = texelFetch(TABLE_masks, ivec3(at.texels.x, at.patch_), 0);
  vec4 coarser = texelFetch(TABLE_masks, ivec3(at.texels.y, at.patch_), 0);
  return mix(finer, coarser, at.coarse) * TABLE_weights;
#else
  return TABLE_weights;
#endif
}

#ifndef TABLE_MEASURED

void TABLE_view_images(inout TABLE_Point point, vec2 direction)
{
  for (int i = 0; i < TABLE_IMAGES; i++) {
    point.images[i] = TABLE_view_quad(TABLE_VIEW_IMAGES + i, direction);
  }
}

/* Mean (the same in Y, U and V) and deviation of a material's image of a light and the view. */
vec4 TABLE_image(TABLE_Point point, vec2 direction, int material)
{
  const ivec3 images[TABLE_MATERIALS] = TABLE_IMAGES_OF; /* first of mean, of deviation, end */
  vec2 found = vec2(0.0);
  ivec3 own = images[material];
  for (int i = own.x; i < own.y; i++) {
    found.x += dot(TABLE_light_quad(TABLE_LIGHT_IMAGES + i, direction), point.images[i]);
  }
  for (int i = own.y; i < own.z; i++) {
    found.y += dot(TABLE_light_quad(TABLE_LIGHT_IMAGES + i, direction), point.images[i]);
  }
  return found.xxxy;
}

#endif

TABLE_Point TABLE_prepare(vec3 view, vec2 uv, vec2 uv_dx, vec2 uv_dy)
{
  TABLE_Place at = TABLE_place(uv, uv_dx, uv_dy);
  vec2 direction = TABLE_direction(view);
  TABLE_Point point;
  point.weights = TABLE_weights_at(at);
  TABLE_view_images(point, direction);
  for (int i = 0; i < 4 * TABLE_LIGHT_QUADS; i++) {
    point.reduced[i] = 0.0;
  }
  int place = 0;
  int part = 0;
  do {
    ivec3 first = ivec3(TABLE_list(at.patch_, 2 * part).xyz);
    ivec3 quads = ivec3(TABLE_list(at.patch_, 2 * part + 1).xyz);
    float texels[4 * TABLE_TEXEL_QUADS];
    float views[4 * TABLE_VIEW_QUADS];
    int i = 0;
    do {
      int quad = int(TABLE_list(at.patch_, first.z + i).x);
      vec4 rows = texelFetch(TABLE_texels, ivec3(at.texels.x, 0, quad), 0);
      if (at.coarse > 0.0) {
        rows = mix(rows, texelFetch(TABLE_texels, ivec3(at.texels.y, 0, quad), 0), at.coarse);
      }
      texels[4 * i] = rows.x;
      texels[4 * i + 1] = rows.y;
      texels[4 * i + 2] = rows.z;
      texels[4 * i + 3] = rows.w;
      i++;
    } while (i < quads.x);
    i = 0;
    do {
      point.quads[place] = int(TABLE_list(at.patch_, first.z + i).y);
      place++;
      i++;
    } while (i < quads.y);
    point.ends[part] = place;
    i = 0;
    do {
      vec4 rows = TABLE_view_quad(int(TABLE_list(at.patch_, first.z + i).z), direction);
      views[4 * i] = rows.x;
      views[4 * i + 1] = rows.y;
      views[4 * i + 2] = rows.z;
      views[4 * i + 3] = rows.w;
      i++;
    } while (i < quads.z);
    i = 0;
    do {
      vec4 one = texelFetch(TABLE_coefficients, ivec3(first.x + i, at.patch_), 0);
      ivec3 places = ivec3(one.yzw);
      point.reduced[places.y] += one.x * texels[places.x] * views[places.z];
      i++;
    } while (i < first.y);
    part++;
  } while (part < 3 * TABLE_MATERIALS);
  return point;
}

/* Y, U and V of the logarithm of the colour, summed over materials. */
vec3 TABLE_log(TABLE_Point point, vec3 light)
{
  vec2 direction = TABLE_direction(light);
  vec3 found = vec3(0.0);
  vec3 parts = vec3(0.0);
  int place = 0;
  int part = 0;
  do {
    float sum = 0.0;
    do {
      vec4 rows = TABLE_light_quad(point.quads[place], direction);
      sum += dot(rows, vec4(point.reduced[4 * place],
                            point.reduced[4 * place + 1],
                            point.reduced[4 * place + 2],
                            point.reduced[4 * place + 3]));
      place++;
    } while (place < point.ends[part]);
    parts[part % 3] = sum;
    part++;
    if (part % 3 == 0) {
      int material = part / 3 - 1;
      vec4 image = TABLE_image(point, direction, material);
      found += point.weights[material] * (parts * image.w + image.xyz);
    }
  } while (part < 3 * TABLE_MATERIALS);
  return found;
}

/* The value for one light in the tangent frame, each channel not below 0; lights below the lowest
 * measured one fade. */
vec3 TABLE_value(TABLE_Point point, vec3 light)
{
  vec3 colour = nacre_from_log(TABLE_log(point, light), TABLE_TO_RGB, TABLE_OFFSET);
  return colour * clamp(light.z / TABLE_LOWEST, 0.0, 1.0);
}
