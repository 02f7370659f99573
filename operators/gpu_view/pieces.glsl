// SPDX-License-Identifier: GPL-3.0-or-later
// Where rays meet the pieces of a leaf, and the light there (methods 7.2k).
//
// Moeller and Trumbore, Fast, Minimum Storage Ray/Triangle Intersection, 1997, from the leaf's lower corner on: so
// float32 is fine enough in small leaves, too, and all pieces of a leaf see the same ray.

#define LAST 0x80000000u
#define HOLES 0x40000000u
#define SLACK 0.01      // of a leaf's side, beyond the ends of its box
#define ROUNDING 3e-7   // of corners
#define EDGE 1e-6       // beyond the edges of triangles, so that no ray passes between two

float modulo(float a, float n) { return a - n * floor(a / n); }

// A texel's number along an axis by the wrap mode; -1 outside of a texture that ends at its border. index: -1 to size
// where it repeats, to twice the size where it is mirrored.
int wrapped(int index, int size, uint wrap) {
  if (index >= 0 && index < size) return index;
  if (wrap == EXTEND) return clamp(index, 0, size - 1);
  if (wrap == REPEAT) return index < 0 ? size - 1 : 0;
  if (wrap == MIRROR) return index < 0 ? 0 : max(2 * size - 1 - index, 0);
  return -1;
}

// Opacity times colour, and opacity, between four texels.
vec4 bilinear(uvec3 level, uint wrap, vec2 place) {
  vec2 at = place * vec2(level.zy) - 0.5, low = floor(at);
  at -= low;
  vec4 sum = vec4(0.0);
  for (int corner = 0; corner < 4; corner++) {
    int column = wrapped(int(low.x) + (corner & 1), int(level.z), wrap);
    int row = wrapped(int(low.y) + (corner >> 1), int(level.y), wrap);
    float weight = ((corner & 1) == 1 ? at.x : 1.0 - at.x) * (corner >> 1 == 1 ? at.y : 1.0 - at.y);
    uint word = wrap == BLACK ? 0xFF000000u : 0u;
    if (row >= 0 && column >= 0) {
      word = floatBitsToUint(texelFetch(texels, texel(level.x + uint(row) * level.z + uint(column)), 0).r);
    }
    vec4 bytes = vec4(word & 255u, (word >> 8) & 255u, (word >> 16) & 255u, word >> 24) * (1.0 / 255.0);
    sum += weight * vec4(bytes.rgb * bytes.rgb, bytes.a);
  }
  return sum;
}

// Colour and opacity of a chain's nearest level. level: for a chain of one texel; least: opacity that is seen, below 0
// for any share.
vec4 mean_of(uint chain, vec2 uv, float level, float least) {
  uvec4 own = floatBitsToUint(texelFetch(chains, texel(3u * chain), 0));  // first level, their number, wrap, detail
  vec3 across = texelFetch(chains, texel(3u * chain + 1u), 0).xyz, up = texelFetch(chains, texel(3u * chain + 2u), 0).xyz;
  vec2 place = vec2(dot(across, vec3(uv, 1.0)), dot(up, vec3(uv, 1.0)));
  int number = int(clamp(level + uintBitsToFloat(own.w) + 0.5, 0.0, float(own.y) - 1.0));
  if (own.z == REPEAT) place = vec2(modulo(place.x, 1.0), modulo(place.y, 1.0));
  else if (own.z == MIRROR) place = vec2(modulo(place.x, 2.0), modulo(place.y, 2.0));
  else {
    if (place != clamp(place, 0.0, 1.0)) number = 0;  // coarse levels hold the whole image, and there is only its border
    place = clamp(place, -1.0, 2.0);
  }
  uvec3 at = floatBitsToUint(texelFetch(mips, texel(own.x + uint(number)), 0).xyz);
  vec4 sum = bilinear(at, own.z, place);
  if (sum.a <= 1e-6) return vec4(0.0);
  float opacity = min(sum.a, 1.0);
  if (number == 0 && least >= 0.0) opacity = sum.a >= least ? 1.0 : 0.0;  // the finest level keeps its opacity uncut
  return vec4(sum.rgb / sum.a, opacity);
}

// Base colour and opacity of a point of a triangle, means over a footprint. weights: of the last two corners.
vec4 base_of(uint triangle, vec2 weights, float footprint) {
  vec4 ends = texelFetch(corners, texel(3u * triangle), 0), more = texelFetch(corners, texel(3u * triangle + 1u), 0);
  uint row = 2u * uint(more.w);
  uvec4 material = floatBitsToUint(texelFetch(materials, texel(row), 0));  // chains, reflects, threshold
  vec4 base = texelFetch(materials, texel(row + 1u), 0);
  if (int(material.x) >= 0) {
    vec2 uv = (1.0 - weights.x - weights.y) * texelFetch(uvs, texel(3u * triangle), 0).xy;
    uv += weights.x * texelFetch(uvs, texel(3u * triangle + 1u), 0).xy;
    uv += weights.y * texelFetch(uvs, texel(3u * triangle + 2u), 0).xy;
    float level = ends.w + float(floatBitsToUint(footprint)) * (1.0 / 8388608.0) - 127.0;  // nearly the logarithm
    float threshold = uintBitsToFloat(material.w), opacity = base.a;
    bool cut = threshold >= 0.0;
    vec4 seen = mean_of(material.x, uv, level, cut ? threshold / opacity : -1.0);
    base = vec4(seen.rgb, cut ? seen.a : opacity * seen.a);
    if (int(material.y) >= 0) base.rgb = mean_of(material.y, uv, level, -1.0).rgb;  // the colour has its own layout
  }
  return vec4(material.z == 0u ? vec3(1.0) : max(base.rgb, vec3(LEAST_BASE)), base.a);
}

// A number in [0, 1) of a ray and a piece (PCG of Jarzynski and Olano, Hash Functions for GPU Rendering, 2020).
float drawn(uint piece) {
  uvec3 v = uvec3(gl_GlobalInvocationID.xy, piece ^ (floatBitsToUint(view.jitter.z) << 7)) * 1664525u + 1013904223u;
  v.x += v.y * v.z; v.y += v.z * v.x; v.z += v.x * v.y;
  v ^= v >> 16u;
  v.x += v.y * v.z;
  return float(v.x >> 8) * (1.0 / 16777216.0);
}

// Side of the footprint, on textures, of a ray at a length.
float footprint_at(Ray ray, float t) { return view.right.w * (view.lens.z + view.lens.w * t * ray.speed); }

// Whether a ray meets a piece of a leaf between the lengths at which it enters and leaves its box; then which, and where.
bool meet_pieces(Ray ray, uint leaf, vec3 cell, float size, float start, float enter, float leave, inout Hit hit) {
  float slack = SLACK * size + ROUNDING, first = max(enter - slack, start) - enter, nearest = leave + slack - enter;
  vec3 corner = mix(cell, 1.0 / size - 1.0 - cell, ray.down) * size;
  vec3 origin = ((mix(ray.whole, 1.0 - ray.whole, ray.down) - corner) + ray.rest * (1.0 - 2.0 * ray.down));
  origin += enter * ray.direction;
  bool found = false;
  uint index = floatBitsToUint(texelFetch(first_pieces, texel(leaf), 0).r);
  for (;;) {
    uint word = floatBitsToUint(texelFetch(pieces, texel(index), 0).r), triangle = word & (HOLES - 1u);
    vec3 a = texelFetch(corners, texel(3u * triangle), 0).xyz;
    vec3 b = texelFetch(corners, texel(3u * triangle + 1u), 0).xyz - a;
    vec3 c = texelFetch(corners, texel(3u * triangle + 2u), 0).xyz - a;
    vec3 from = origin - (a - corner), p = cross(ray.direction, c), q = cross(from, b);
    float volume = dot(b, p), scale = 1.0 / volume;  // above 0 in front
    vec2 weights = vec2(dot(from, p), dot(ray.direction, q)) * scale;
    float t = dot(c, q) * scale;
    if (weights.x > -EDGE && weights.y > -EDGE && weights.x + weights.y < 1.0 + EDGE && t > first && t < nearest) {
      bool passed = false;
      if ((word & HOLES) != 0u) {
        float opacity = base_of(triangle, weights, footprint_at(ray, enter + t)).a;
        passed = opacity < 1.0 && opacity <= drawn(index);
      }
      if (!passed) {
        found = true;
        nearest = t;
        hit.piece = index;
        hit.back = volume < 0.0;
        hit.weights = weights;
      }
    }
    if ((word & LAST) != 0u) break;
    index++;
  }
  if (found) hit.t = enter + nearest;
  return found;
}

// Light of the piece that a ray meets: that of the side it meets, times the base colour there.
vec3 piece_light(Ray ray, Hit hit) {
  uvec2 both = floatBitsToUint(texelFetch(lights, texel(hit.piece), 0).xy);
  uint light = hit.back ? both.y : both.x, triangle = floatBitsToUint(texelFetch(pieces, texel(hit.piece), 0).r);
  float scale = ldexp(1.0 / 512.0, int(light >> 27) - 15);
  vec3 base = base_of(triangle & (HOLES - 1u), hit.weights, footprint_at(ray, hit.t)).rgb;
  return base * scale * vec3(light & 511u, (light >> 9) & 511u, (light >> 18) & 511u);
}
