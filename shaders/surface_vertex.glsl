void main()
{
  vec4 world = nacre_object * vec4(position, 1.0);
  mat3 turn = mat3(nacre_object);
  nacre_position = world.xyz;
  nacre_normal = transpose(inverse(turn)) * normal;
  /* A mirrored object turns the bitangent's side round, as a mirrored UV map does. */
  nacre_tangent = vec4(turn * tangent.xyz, tangent.w * sign(determinant(turn)));
  nacre_uv = uv;
  gl_Position = nacre_camera.projection * world;
}
