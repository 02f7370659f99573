// SPDX-License-Identifier: GPL-3.0-or-later
// Error to be expected of the pixels of a band, by themselves and the eight around each (methods 12), as their score.
//
// Inputs go into the first layer as they are made. All differences of luminance are divided by a scale, which is known
// once the last one is: they have sums of their own until then. `packing.INPUTS` has the order of inputs.

#define VECTORS (UNITS / 4)
#define ROW (VECTORS + 1)
#define WINDOW (view.bounds.x + 1)  // bounds from a uniform buffer, as in decode.glsl
#define DEPTH (3 * view.bounds.y)
GROUP_MEMORY float values[UNITS * 64];

vec4 sums[VECTORS], scaled[VECTORS];
float linear, scaled_linear, scale;

#define V(row) values[(row) * 64 + int(gl_LocalInvocationIndex)]

void add(int row, float value) {
  for (int k = 0; k < VECTORS; k++) sums[k] += value * estimator.inputs[ROW * row + k];
  linear += value * estimator.inputs[ROW * row + VECTORS].y;
}

void add_difference(int row, float value) {
  vec4 ends = estimator.inputs[ROW * row + VECTORS];
  for (int k = 0; k < VECTORS; k++) scaled[k] += value * estimator.inputs[ROW * row + k];
  scaled_linear += value * ends.y;
  scale += ends.x * value * value;
}

vec3 normal_of(uint node) {
  if (node == NONE) return vec3(0.0);
  int word = int(floatBitsToUint(texelFetch(normals, texel(node), 0).r));
  vec3 mean = vec3(word << 24 >> 24, word << 16 >> 24, word << 8 >> 24);
  return dot(mean, mean) > 0.0 ? normalize(mean) : mean;
}

// Adds what a pixel sees in itself and around it; returns whether any of the nine has met something.
bool add_window(ivec2 pixel, vec4 seen, float depth, float per_pixel, vec3 normal) {
  bool any_met = false;
  for (int place = 0; place < WINDOW; place++) {
    ivec2 at = clamp(pixel + ivec2(place % 3 - 1, place / 3 - 1), ivec2(0), view.size.xy - 1);
    uint node = texelFetch(hit_node, at, 0).r;
    vec4 near = texelFetch(hit_seen, at, 0), found = texelFetch(decoded, at, 0);
    bool met = node != NONE;
    float slope = ((met ? near.w : FAR) - depth) * per_pixel;
    add_difference(6 * place, near.x - seen.x);
    add_difference(6 * place + 1, found.y - seen.x);
    add(6 * place + 2, met ? 1.0 : 0.0);
    add(6 * place + 3, slope / (1.0 + abs(slope)));
    add(6 * place + 4, dot(normal_of(node), normal));
    add(6 * place + 5, found.x);
    any_met = any_met || met;
  }
  return any_met;
}

void main() {
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy) + ivec2(0, view.size.z);
  if (pixel.x >= view.size.x || pixel.y >= view.size.y) return;
  uint node = texelFetch(hit_node, pixel, 0).r;
  vec4 seen = texelFetch(hit_seen, pixel, 0), found = texelFetch(decoded, pixel, 0);
  float ratio = texelFetch(hit_entry, pixel, 0).w;
  uint children = node == NONE ? 0u : node_words(node).y & 255u;
  vec3 normal = normal_of(node);
  for (int k = 0; k < VECTORS; k++) { sums[k] = estimator.bias_1[k]; scaled[k] = vec4(0.0); }
  linear = scaled_linear = 0.0;
  scale = FLOOR;
  bool counts = add_window(pixel, seen, node == NONE ? FAR : seen.w, ldexp(1.0 / SLOPE, int(seen.z)) / ratio, normal);
  int row = 6 * WINDOW;
  add(row, seen.x);
  add_difference(row + 1, mix(luminance_of(node_words(0u)), found.y, found.x) - seen.x);
  add(row + 2, abs(dot(normal, make_ray(pixel).direction)));
  add(row + 3, ratio);
  add(row + 4, float(bitCount(children)) * 0.125);
  add(row + 5, found.z);
  add(row + 6, log(scale));
  float inverse = inversesqrt(scale);
  for (int k = 0; k < VECTORS; k++) {
    vec4 sum = max(sums[k] + inverse * scaled[k], 0.0);
    for (int c = 0; c < 4; c++) V(4 * k + c) = sum[c];
    sums[k] = estimator.bias_2[k];
  }
  for (int unit = 0; unit < DEPTH; unit++) {
    float value = V(unit);
    for (int k = 0; k < VECTORS; k++) sums[k] += value * estimator.layer_2[VECTORS * unit + k];
  }
  vec2 end = estimator.ends[UNITS].xy + vec2(0.0, linear + inverse * scaled_linear);
  for (int k = 0; k < VECTORS; k++) {
    vec4 sum = max(sums[k], 0.0);
    for (int c = 0; c < 4; c++) end += sum[c] * estimator.ends[4 * k + c].xy;
  }
  float error = sqrt(scale * (exp(clamp(end.x, LOWEST, HIGHEST)) + end.y * end.y));
  imageStore(out_scored, pixel, vec4(found.xyz, counts ? error : 0.0));
}
