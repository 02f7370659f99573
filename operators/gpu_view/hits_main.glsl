// SPDX-License-Identifier: GPL-3.0-or-later
// Hits of all pixels: node, entry point and ratio; luminance, length, level, distance along the axis.

void main() {
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (pixel.x >= view.size.x || pixel.y >= view.size.y) return;
  Ray ray = make_ray(pixel);
  Hit hit = trace(ray, start_of(ray), 1.0);
  vec4 entry = vec4(0.0, 0.0, 0.0, 1.0), seen = vec4(0.0);
  if (hit.node != NONE) {
    float pixel_side = view.lens.z + view.lens.w * hit.t * ray.speed;
    entry = vec4(entry_of(ray, hit), clamp(pixel_side * ldexp(1.0, hit.level), 0.5, 1.0));
    seen = vec4(luminance_along(hit.node, hit.words, ray.direction), hit.t, float(hit.level), hit.t * ray.speed);
  }
  imageStore(out_node, pixel, uvec4(hit.node));
  imageStore(out_entry, pixel, entry);
  imageStore(out_seen, pixel, seen);
}
