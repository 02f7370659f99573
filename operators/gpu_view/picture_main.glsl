// SPDX-License-Identifier: GPL-3.0-or-later
// A sample of each pixel, in colour with the world behind.

void main() {
  ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
  if (pixel.x >= view.size.x || pixel.y >= view.size.y) return;
  Ray ray = make_ray(pixel);
  Hit hit = trace(ray, start_of(ray), 1.0);
  vec4 seen = vec4(0.0);
#ifdef EXACT
  if (hit.piece != NONE) seen = vec4(piece_light(ray, hit), 1.0);
  else
#endif
  if (hit.node != NONE) {
    vec3 light = color_along(hit.node, hit.words, ray.direction) + above_white(hit.node, hit.words, ray.direction);
    seen = vec4(light * view.sight.w, 1.0);
  }
  else if (view.counts.z > 0) seen = vec4(world_along(ray.direction), 1.0);
  imageStore(out_sample, pixel, seen);
}
