// SPDX-License-Identifier: GPL-3.0-or-later
// Heatmap of a view: the paper's score, coverage, level (in colours of a ramp), or the luminance that is expected.

#define RAMP 256u
#define PRIORITY 1
#define COVERAGE 2
#define PREDICTED 3

vec3 ramp_color(float share) {
  return texelFetch(ramp, texel(uint(clamp(share, 0.0, 1.0) * float(RAMP - 1u) + 0.5)), 0).rgb;
}

// Luminance of the first voxel behind a pixel's patch, fine as the finer rays of the kernels (methods 3.12).
float light_behind(Ray ray, vec4 seen) {
  Hit behind = trace(ray, seen.y + 1.5 * ldexp(1.0, -int(seen.z)), view.sight.w);
  return behind.node == NONE ? 0.0 : luminance_along(behind.node, behind.words, ray.direction);
}

float encoded(float light) { return light < 0.0031308 ? 12.92 * light : 1.055 * pow(light, 1.0 / 2.4) - 0.055; }

void main() {
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (pixel.x >= view.size.x || pixel.y >= view.size.y) return;
  vec4 color = vec4(0.0);  // nothing where nothing is met
  if (texelFetch(hit_node, pixel, 0).r != NONE) {
    vec4 seen = texelFetch(hit_seen, pixel, 0), found = texelFetch(decoded, pixel, 0);
    int kind = view.size.w;
    float share = kind == PRIORITY ? found.w : kind == COVERAGE ? found.x : seen.z;
    if (kind == PREDICTED) {
      float expected = found.x * found.y;
      if (found.x < 1.0) expected += (1.0 - found.x) * light_behind(make_ray(pixel), seen);
      color = vec4(vec3(encoded(expected)), 1.0);
    }
    else color = vec4(ramp_color(share / view.jitter.w), 1.0);
  }
  imageStore(out_heat, pixel, color);
}
