// SPDX-License-Identifier: GPL-3.0-or-later
// Coverage, luminance, whether there is look-ahead, and the paper's score of the pixels of a band (methods 3.12).

void main() {
#ifdef GROUP_INDEX
  column = int(gl_LocalInvocationIndex);
#else
  column = 0;
#endif
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy) + ivec2(0, view.size.z);
  if (pixel.x >= view.size.x || pixel.y >= view.size.y) return;
  uint node = texelFetch(hit_node, pixel, 0).r;
  vec4 result = vec4(1.0, 0.0, 0.0, 0.0);
  if (node != NONE) {
    result.y = texelFetch(hit_seen, pixel, 0).x;
    int row = coded_row(node);
    if (row >= 0) {
      vec4 entry = texelFetch(hit_entry, pixel, 0);
      vec3 along = make_ray(pixel).direction, up = view.camera_up.xyz;
      up = normalize(up - dot(up, along) * along);
      place_inputs(node, node_words(node), uint(row), entry.xyz, along, up, entry.w);
      float shown = result.y;
      result.xy = decode();
      result.zw = vec2(1.0, abs(1.0 - result.x) + 5.0 * abs(shown - result.y));
    }
  }
  imageStore(out_decoded, pixel, result);
}
