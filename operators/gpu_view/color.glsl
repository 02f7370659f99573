// SPDX-License-Identifier: GPL-3.0-or-later
// Colour of voxels, of light above white (methods 7.1b, 7.2d), and of the world behind.

vec3 decoded_color(float luminance, uint hue) {
  float red = float(hue & 255u), blue = float((hue >> 8) & 255u), green = max(255.0 - red - blue, 0.0);
  return vec3(red, green, blue) * (luminance / (0.2126 * red + 0.7152 * green + 0.0722 * blue));
}

vec3 color_along(uint node, uvec2 words, vec3 along) {
  uint hue = floatBitsToUint(texelFetch(hues, texel(node >> 1), 0).r) >> ((node & 1u) * 16u);
  vec3 mean = decoded_color(luminance_of(words), hue);
  if ((words.y & SIDED) == 0u) return mean;
  uint row = side_row(node);
  Faces faces = faces_along(row, along);
  float rest = rest_of(words, faces, along), seen = faces.weight.x + faces.weight.y + faces.weight.z;
  vec3 total = rest * mean;
  for (int axis = 0; axis < 3; axis++) {
    uint hues_ = side_words(row, axis).y;
    total += decoded_color(faces.weight[axis] * faces.light[axis], along[axis] > 0.0 ? hues_ >> 16 : hues_);
  }
  return total / (rest + seen);
}

// What the clamp has taken from a node, found by halving; as much as its side is bright.
vec3 above_white(uint node, uvec2 words, vec3 along) {
  if ((words.y & BRIGHT) == 0u) return vec3(0.0);
  uint low = 0u, high = uint(view.counts.x);
  while (low < high) {
    uint middle = (low + high) >> 1;
    if (floatBitsToUint(texelFetch(bright, texel(middle), 0).x) < node) low = middle + 1u;
    else high = middle;
  }
  float mean = max(luminance_of(words), 1.0 / 65535.0);
  return texelFetch(bright, texel(low), 0).yzw * (luminance_along(node, words, along) / mean);
}

vec3 world_texel(uint face, uvec2 place, uint side) {
  uvec2 words = floatBitsToUint(texelFetch(world, texel((face * side + place.y) * side + place.x), 0).xy);
  return vec3(unpackHalf2x16(words.x), unpackHalf2x16(words.y).x);
}

// Light of a cube map along a direction, between four texels of a face (`cube_map.py`).
vec3 world_along(vec3 d) {
  vec3 size = abs(d);
  uint side = uint(view.counts.z), face;
  vec3 seen;  // right, up and forward on the face
  if (size.x >= size.y && size.x >= size.z) {
    face = d.x < 0.0 ? 1u : 0u;
    seen = vec3(d.x < 0.0 ? d.y : -d.y, d.z, size.x);
  }
  else if (size.y >= size.z) {
    face = d.y < 0.0 ? 3u : 2u;
    seen = vec3(d.y < 0.0 ? -d.x : d.x, d.z, size.y);
  }
  else {
    face = d.z < 0.0 ? 5u : 4u;
    seen = vec3(d.x, d.z < 0.0 ? d.y : -d.y, size.z);
  }
  vec2 place = clamp((seen.xy / seen.z + 1.0) * (0.5 * float(side)) - 0.5, vec2(0.0), vec2(float(side) - 1.0));
  uvec2 low = min(uvec2(place), uvec2(max(side, 2u) - 2u)), high = min(low + 1u, uvec2(side - 1u));
  vec2 share = place - vec2(low);
  vec3 lower = mix(world_texel(face, low, side), world_texel(face, uvec2(high.x, low.y), side), share.x);
  vec3 upper = mix(world_texel(face, uvec2(low.x, high.y), side), world_texel(face, high, side), share.x);
  return mix(lower, upper, share.y);
}
