// SPDX-License-Identifier: GPL-3.0-or-later
// One more sample of each pixel through the pixel filter, into the mean of those before it (methods 7.5b).

float weight_of(uint at) { return texelFetch(weights, ivec2(int(at & (WIDTH - 1u)), int(at >> WIDTH_BITS)), 0).x; }

void main() {
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (pixel.x >= view.size.x || pixel.y >= view.size.y) return;
  int radius = view.size.w / 2;
  uint at = uint(view.jitter.z) * uint(view.size.w * view.size.w);
  vec4 sum = vec4(0.0);
  float total = 0.0;
  for (int y = radius; y >= -radius; y--) {  // the pixel that is seen from here gives to its opposite
    for (int x = radius; x >= -radius; x--) {
      float weight = weight_of(at++);
      ivec2 from = pixel + ivec2(x, y);
      if (from.x < 0 || from.y < 0 || from.x >= view.size.x || from.y >= view.size.y) continue;
      sum += weight * texelFetch(seen, from, 0);
      total += weight;
    }
  }
  vec4 mean = sum / max(total, 1e-20);
  float share = view.jitter.w;
  if (share < 1.0) mean = mix(texelFetch(before, pixel, 0), mean, share);
  imageStore(out_mean, pixel, mean);
}
