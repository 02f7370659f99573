// SPDX-License-Identifier: GPL-3.0-or-later
// Light that a voxel shows along a direction (methods 7.2i): of three of its six faces, or its mean; in colour (7.2d).

// Numbers among the coded nodes (x) and among those with sides (z), and bits that say whether a node is one (y, w).
uvec4 ranks_at(uint node) { return floatBitsToUint(texelFetch(ranks, texel(node >> 5), 0)); }

uint rank_of(uint before, uint bits, uint node) { return before + uint(bitCount(bits & ((1u << (node & 31u)) - 1u))); }

uint side_row(uint node) {
  uvec4 found = ranks_at(node);
  return rank_of(found.z, found.w, node);
}

// Of an axis of a row of sides: roots of the upper and the lower face's luminance, their shares; their hues.
uvec2 side_words(uint row, int axis) { return floatBitsToUint(texelFetch(sides, texel(3u * row + uint(axis)), 0).xy); }

// Of the three faces that a direction runs against: luminance and weight of each. Of a sheet a ray sees one side, so
// only fronts count or only backs, whichever weigh more (an odd share is of backs); black backs count an eighth there.
struct Faces {
  vec3 light, weight;
  bool backs;
};

Faces faces_along(uint row, vec3 along) {
  uvec3 faces;
  for (int axis = 0; axis < 3; axis++) {
    uint word = side_words(row, axis).x;
    faces[axis] = along[axis] > 0.0 ? word >> 8 : word;
  }
  uvec3 shares = (faces >> 16) & 255u;
  vec3 roots = vec3(faces & 255u) * (1.0 / 255.0), weight = abs(along) * vec3(shares), back = vec3(shares & 1u);
  Faces found;
  found.backs = dot(weight, back * (0.125 + 0.875 * sign(roots))) > dot(weight, 1.0 - back);
  found.weight = weight * (found.backs ? back : 1.0 - back);
  found.light = roots * roots;
  return found;
}

// Weight of the mean beside them: of what an inner node leaves open, and a little. The mean is that of fronts.
float rest_of(uvec2 words, Faces faces, vec3 along) {
  vec3 through = 255.0 * abs(along) - faces.weight;
  return 1.0 + ((words.y & 255u) != 0u && !faces.backs ? through.x + through.y + through.z : 0.0);
}

float luminance_along(uint node, uvec2 words, vec3 along) {
  float mean = luminance_of(words);
  if ((words.y & SIDED) == 0u) return mean;
  Faces faces = faces_along(side_row(node), along);
  float rest = rest_of(words, faces, along), seen = faces.weight.x + faces.weight.y + faces.weight.z;
  return (rest * mean + dot(faces.weight, faces.light)) / (rest + seen);
}
