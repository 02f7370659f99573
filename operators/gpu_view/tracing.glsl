// SPDX-License-Identifier: GPL-3.0-or-later
// First voxel that fits a ray's pixel (methods 4.1b, 4.1d): parents on a stack, children by stepping from plane to plane.
//
// In the octree's cube, mirrored so that a ray runs upwards on all axes. float32 holds a place to 2^-24, which is no
// voxel of depth 18; so a ray's origin is a multiple of 2^-12 and a rest, and planes minus the first are exact.
// A node's words: first child, or of a leaf its box; then 8 bits of children, 16 of luminance, flags. With EXACT, rays end
// on the pieces of leaves that have them (pieces.glsl).

#define MAX_LEVELS 24
#define NONE 0xFFFFFFFFu
#define BOXED 0x01000000u
#define SIDED 0x02000000u
#define BRIGHT 0x04000000u
#define PIECED 0x08000000u

ivec2 texel(uint at) { return ivec2(int(at & (WIDTH - 1u)), int(at >> WIDTH_BITS)); }

uvec2 node_words(uint node) { return floatBitsToUint(texelFetch(nodes, texel(node), 0).xy); }

float luminance_of(uvec2 words) { return float((words.y >> 8) & 65535u) * (1.0 / 65535.0); }

struct Ray {
  vec3 whole, rest, inverse;  // origin; 1 / direction
  float speed;                // axial distance per length
  uint mirror;
  vec3 down;                  // 1 on mirrored axes, else 0
  vec3 aim, direction;        // as they are, of any length and of length 1
};

struct Hit {
  uint node;  // NONE for a miss
  uvec2 words;
  float t;
  int level;
  ivec3 cell;  // mirrored
  vec3 low;    // planes that are entered by, mirrored: the cell's, or its box's
  uint piece;  // NONE for a voxel; the side that is seen, and weights of the triangle's last two corners
  bool back;
  vec2 weights;
};

float largest3(vec3 v) { return max(max(v.x, v.y), v.z); }
float smallest3(vec3 v) { return min(min(v.x, v.y), v.z); }

vec3 to_planes(Ray ray, vec3 planes) { return ((planes - ray.whole) - ray.rest) * ray.inverse; }

ivec3 beyond(vec3 planes, float t) {
  return ivec3(planes.x <= t ? 1 : 0, planes.y <= t ? 1 : 0, planes.z <= t ? 1 : 0);
}

Ray make_ray(ivec2 pixel) {
  vec2 size_px = vec2(view.size.xy), picture = (2.0 * (vec2(pixel) + view.jitter.xy) - size_px) / size_px + view.lens.xy;
  vec3 across = picture.x * view.right.xyz + picture.y * view.up.xyz;
  bool perspective = view.sight.z > 0.0;
  vec3 d = perspective ? view.forward.xyz + across : view.forward.xyz;
  Ray ray;
  ray.whole = view.place_whole.xyz;
  ray.rest = view.place_rest.xyz;
  if (!perspective) {
    vec3 more = ray.rest + across, steps = floor(more * SPLIT + 0.5) / SPLIT;
    ray.whole += steps;
    ray.rest = more - steps;
  }
  float size = length(d);
  ray.speed = perspective ? 1.0 / size : 1.0;
  ray.aim = d;
  d /= size;
  ray.direction = d;
  ray.down = vec3(d.x < 0.0 ? 1.0 : 0.0, d.y < 0.0 ? 1.0 : 0.0, d.z < 0.0 ? 1.0 : 0.0);
  ray.mirror = uint(ray.down.x) | uint(ray.down.y) << 1 | uint(ray.down.z) << 2;
  ray.whole = mix(ray.whole, 1.0 - ray.whole, ray.down);
  ray.rest *= 1.0 - 2.0 * ray.down;
  ray.inverse = 1.0 / max(abs(d), vec3(1e-30));
  return ray;
}

float start_of(Ray ray) { return view.sight.x / ray.speed; }

// Lower or upper planes of a leaf's box, mirrored.
vec3 box_planes(Ray ray, uint box, vec3 cell, float size, bool upper) {
  vec3 first = vec3(box & 15u, (box >> 8) & 15u, (box >> 16) & 15u);
  vec3 last = vec3((box >> 4) & 15u, (box >> 12) & 15u, (box >> 20) & 15u);
  vec3 steps = upper ? mix(last, 15.0 - first, ray.down) + 1.0 : mix(first, 15.0 - last, ray.down);
  return (16.0 * cell + steps) * (size * 0.0625);
}

#ifdef EXACT
bool meet_pieces(Ray ray, uint leaf, vec3 cell, float size, float start, float enter, float leave, inout Hit hit);
#endif

// finer: factor on the pixel's side.
Hit trace(Ray ray, float start, float finer) {
  uint stack[MAX_LEVELS];
  Hit hit;
  hit.node = NONE;
  hit.words = uvec2(0u);
  hit.t = 0.0;
  hit.level = 0;
  hit.cell = ivec3(0);
  hit.low = vec3(0.0);
  hit.piece = NONE;
  float at_0 = view.lens.z * finer, per_length = view.lens.w * finer * ray.speed;
  float farthest = view.sight.y / ray.speed;
  float enter = max(start, largest3(to_planes(ray, vec3(0.0))));
  if (!(enter < smallest3(to_planes(ray, vec3(1.0))))) return hit;
  uvec2 here = node_words(0u);  // of the parent, which is stack[level - 1]; `cell` is a child's, at `level`
  if ((here.y & 255u) == 0u || 1.0 < 2.0 * (at_0 + per_length * enter)) {
    if (enter <= farthest) {
      hit.node = 0u;
      hit.words = here;
      hit.t = enter;
    }
    return hit;
  }
  int level = 1;
  stack[0] = 0u;
  float size = 0.5;
  ivec3 cell = beyond(to_planes(ray, vec3(0.5)), enter);
  for (;;) {
    vec3 low = vec3(cell) * size;
    vec3 high = to_planes(ray, low + size);
    float leave = smallest3(high);
    uint octant = (uint(cell.x & 1) | uint(cell.y & 1) << 1 | uint(cell.z & 1) << 2) ^ ray.mirror;
    if (((here.y >> octant) & 1u) != 0u) {
      enter = max(start, largest3(to_planes(ray, low)));
      if (enter < leave) {
        uint child = here.x + uint(bitCount(here.y & ((1u << octant) - 1u)));
        uvec2 words = node_words(child);
        if ((words.y & 255u) == 0u || size < 2.0 * (at_0 + per_length * enter)) {
          bool met = true;
          float end = leave;
          if ((words.y & BOXED) != 0u) {
            low = box_planes(ray, words.x, vec3(cell), size, false);
            enter = max(start, largest3(to_planes(ray, low)));
            end = smallest3(to_planes(ray, box_planes(ray, words.x, vec3(cell), size, true)));
            met = enter < end;
          }
#ifdef EXACT
          if (met && (words.y & PIECED) != 0u) {
            met = meet_pieces(ray, child, vec3(cell), size, start, enter, end, hit);
            if (met) enter = hit.t;
          }
#endif
          if (met) {
            if (enter > farthest) return hit;
            hit.node = child;
            hit.words = words;
            hit.t = enter;
            hit.level = level;
            hit.cell = cell;
            hit.low = low;
            return hit;
          }
        }
        else {
          stack[level] = child;
          here = words;
          size *= 0.5;
          level++;
          cell = 2 * cell + beyond(to_planes(ray, low + size), enter);
          continue;
        }
      }
    }
    ivec3 next = cell + beyond(high, leave);
    int up = findMSB(uint((cell.x ^ next.x) | (cell.y ^ next.y) | (cell.z ^ next.z)));
    cell = next;
    if (up > 0) {  // out of the parent
      level -= up;
      if (level <= 0) return hit;
      cell = next >> up;
      size = ldexp(1.0, -level);
      here = node_words(stack[level - 1]);
    }
  }
  return hit;
}

// Where a ray enters the voxel that stopped it, in [0, 1]^3: by the slopes from the plane that it enters by, since
// lengths and unit directions are rounded once more.
vec3 entry_of(Ray ray, Hit hit) {
  vec3 lengths = to_planes(ray, hit.low), aim = abs(ray.aim);
  int axis = lengths.x >= lengths.y && lengths.x >= lengths.z ? 0 : lengths.y >= lengths.z ? 1 : 2;
  vec3 way = (hit.low[axis] - ray.whole[axis] - ray.rest[axis]) * (aim / aim[axis]);
  if (!(lengths[axis] >= hit.t)) way = hit.t * normalize(aim);  // it begins within
  float cells = ldexp(1.0, hit.level);
  vec3 local = clamp(((ray.whole - vec3(hit.cell) / cells) + ray.rest + way) * cells, 0.0, 1.0);
  return mix(local, 1.0 - local, ray.down);
}
