/* The grid points round a surface's frame, as tables/orientations.py: texels of a picture of all
 * orientations, and weights. The columns of the frame are tangent, bitangent and normal. */
struct NacreCorners {
  ivec2 texels[4];
  vec4 weights;
};

NacreCorners nacre_corners(mat3 frame, int grid)
{
  int hand = determinant(frame) < 0.0 ? 1 : 0;
  if (hand == 1) {
    frame[1] = -frame[1];
  }
  /* The half turn of the world that leaves least to turn. */
  vec3 own = vec3(frame[0].x, frame[1].y, frame[2].z);
  float best = own.x + own.y + own.z;
  int turn = 0;
  for (int axis = 0; axis < 3; axis++) {
    float trace = 2.0 * own[axis] - (own.x + own.y + own.z);
    if (trace > best) {
      best = trace;
      turn = axis + 1;
    }
  }
  vec3 signs = vec3(turn < 2 ? 1.0 : -1.0, turn % 2 == 0 ? 1.0 : -1.0, 1.0);
  signs.z = signs.x * signs.y;
  vec3 tangent = frame[0] * signs;
  vec3 bitangent = frame[1] * signs;
  vec3 normal = frame[2] * signs;
  vec3 ratios = vec3(bitangent.z - normal.y, normal.x - tangent.z, tangent.y - bitangent.x) /
                max(1.0 + best, 1e-3);
  vec3 place = atan(clamp(ratios, -1.0, 1.0)) * (4.0 / 3.14159265358979);

  /* A cell's six tetrahedra share the diagonal away from the cube's middle. */
  int middle = grid / 2;
  vec3 away = abs(place) * float(middle);
  vec3 corner = min(floor(away), vec3(float(middle - 1)));
  vec3 fraction = away - corner;
  float least = min(fraction.x, min(fraction.y, fraction.z));
  float most = max(fraction.x, max(fraction.y, fraction.z));
  float second = fraction.x + fraction.y + fraction.z - least - most;
  NacreCorners found;
  found.weights = vec4(1.0 - most, most - second, second - least, least);
  vec3 outward = sign(place);
  for (int i = 0; i < 4; i++) {
    vec3 step = vec3(float(i == 3));
    if (i == 1) {
      step = vec3(equal(fraction, vec3(most)));
    }
    else if (i == 2) {
      step = vec3(greaterThan(fraction, vec3(least)));
    }
    ivec3 point = ivec3((corner + step) * outward) + middle;
    found.texels[i] = ivec2(point.z * grid + point.x, (hand * 4 + turn) * grid + point.y);
  }
  return found;
}
