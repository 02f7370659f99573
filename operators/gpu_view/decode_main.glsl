// SPDX-License-Identifier: GPL-3.0-or-later
// Coverage, luminance, whether there is look-ahead, and the paper's score of the pixels of a band (methods 3.12).

GROUP_MEMORY uint decoded_here;  // whether any pixel of the group is decoded

void main() {
  lane = int(gl_LocalInvocationID.x);
  part = int(gl_LocalInvocationID.y);
  found = 0;
  ivec2 pixel = ivec2(gl_WorkGroupID.xy) * ivec2(8, 4) + ivec2(lane & 7, (lane >> 3) + view.size.z);
  bool seen = pixel.x < view.size.x && pixel.y < view.size.y;
  uint node = seen ? texelFetch(hit_node, pixel, 0).r : NONE;
  int row = node == NONE ? -1 : coded_row(node);
  float shown = node == NONE ? 0.0 : texelFetch(hit_seen, pixel, 0).x;
  vec4 result = vec4(1.0, shown, 0.0, 0.0);
  decoded_here = 0u;
  barrier();
  if (row >= 0) decoded_here = 1u;
  barrier();
  if (decoded_here != 0u) {  // the same for all threads
    for (int k = 16 * part; k < 16 * part + SIXTEEN; k++) V(COVERED_ROW + k) = 0.0;
    barrier();
    if (row >= 0) {
      vec4 entry = texelFetch(hit_entry, pixel, 0);
      vec3 along = make_ray(pixel).direction, up = view.camera_up.xyz;
      up = normalize(up - dot(up, along) * along);
      place_inputs(node, node_words(node), uint(row), entry.xyz, along, up, entry.w);
    }
    barrier();
    place_code();
    barrier();
    LAYER(layer_1.w, 0, INPUTS, V, put_other, vec4(0.0))
    barrier();
    LAYER(layer_2.w, 20, WIDE, W, put, vec4(0.0))
    barrier();
    LAYER(layer_3.w, 40, WIDE, V, put_other, vec4(0.0))
    barrier();
    LAYER(layer_4.w, 60, WIDE, W, put, vec4(-1e30))
    barrier();
    W(part) = largest_logit();
    barrier();
    float most = max(max(W(0), W(1)), max(W(2), W(3)));
    vec2 sums = mixed(most);
    W(4 + part) = sums.x;
    W(8 + part) = sums.y;
    barrier();
    if (part == 0 && row >= 0) {  // the voxel's own luminance is mixed, too
      float own = exp(max(V(65) - most, -80.0));
      float total = own + W(4) + W(5) + W(6) + W(7), light = own * shown + W(8) + W(9) + W(10) + W(11);
      result = vec4(coverage(), light / total, 1.0, 0.0);
      result.w = abs(1.0 - result.x) + 5.0 * abs(shown - result.y);
    }
  }
  if (part == 0 && seen) imageStore(out_decoded, pixel, result);
}
