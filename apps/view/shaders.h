/* Shader sources of render.c. Colours are linear light until the last line. */
#ifndef VIEW_SHADERS_H
#define VIEW_SHADERS_H
// clang-format off

#define VIEW_GLSL "#version 330 core\n"

/* Value noise with its gradient, in units of 1/cell. */
#define VIEW_NOISE                                                                                            \
    "float hash(vec3 p) { p = fract(p * 0.3183099 + vec3(0.1, 0.17, 0.13)); p *= 17.0;\n"                     \
    "  return fract(p.x * p.y * p.z * (p.x + p.y + p.z)); }\n"                                                \
    "vec4 noise(vec3 x) {\n"                                                                                  \
    "  vec3 i = floor(x), w = x - i, u = w * w * (3.0 - 2.0 * w), du = 6.0 * w * (1.0 - w);\n"                \
    "  float a = hash(i), b = hash(i + vec3(1, 0, 0)), c = hash(i + vec3(0, 1, 0)), d = hash(i + vec3(1, 1, 0)),\n" \
    "        e = hash(i + vec3(0, 0, 1)), f = hash(i + vec3(1, 0, 1)), g = hash(i + vec3(0, 1, 1)), h = hash(i + vec3(1, 1, 1));\n" \
    "  float k0 = a, k1 = b - a, k2 = c - a, k3 = e - a, k4 = a - b - c + d, k5 = a - c - e + g, k6 = a - b - e + f,\n" \
    "        k7 = -a + b + c - d + e - f - g + h;\n"                                                          \
    "  return vec4(k0 + k1 * u.x + k2 * u.y + k3 * u.z + k4 * u.x * u.y + k5 * u.y * u.z + k6 * u.z * u.x + k7 * u.x * u.y * u.z,\n" \
    "    du * vec3(k1 + k4 * u.y + k6 * u.z + k7 * u.y * u.z, k2 + k5 * u.z + k4 * u.x + k7 * u.z * u.x,\n"  \
    "              k3 + k6 * u.x + k5 * u.y + k7 * u.x * u.y)); }\n"

/* Display value of linear light: c^(1/2.2), approximated by square roots, which cost less. */
#define VIEW_DISPLAY                                                                                          \
    /* Noise of half a step hides the 256 steps in wide gradients. */                            \
    "float dither() { return (fract(sin(dot(gl_FragCoord.xy, vec2(12.9898, 78.233))) * 43758.5453) - 0.5) / 255.0; }\n" \
    "vec3 display(vec3 c) { vec3 a = sqrt(clamp(c, 0.0, 1.0)), b = sqrt(a); return 0.5851 * a + 0.7831 * b - 0.3683 * sqrt(b); }\n"

static const char *const view_depth_vertex =
    VIEW_GLSL "layout(location = 0) in vec3 at; uniform mat4 to_clip; void main() { gl_Position = to_clip * vec4(at, 1.0); }\n";
static const char *const view_depth_fragment = VIEW_GLSL "out vec4 colour; void main() { colour = vec4(1.0); }\n";

/* The shadow on the floor, blurred in one direction per pass. */
static const char *const view_blur_vertex =
    VIEW_GLSL "out vec2 uv; void main() { vec2 p = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0; uv = p; gl_Position = vec4(p * 2.0 - 1.0, 0.0, 1.0); }\n";
static const char *const view_blur_fragment =
    VIEW_GLSL "in vec2 uv; uniform sampler2D image; uniform vec2 stride; out vec4 colour;\n"
    "float two(float at) { return texture(image, uv + at * stride).r + texture(image, uv - at * stride).r; }\n"
    "void main() { colour = vec4(0.16 * texture(image, uv).r + 0.15 * two(1.0) + 0.12 * two(2.0) + 0.08 * two(3.0) + 0.05 * two(4.0) + 0.02 * two(5.0)); }\n";

static const char *const view_sky_fragment =
    VIEW_GLSL VIEW_DISPLAY "in vec2 uv; out vec4 colour; uniform vec3 low, high;\n"
    "void main() { vec3 c = mix(low, high, uv.y); vec2 d = uv - 0.5; c *= 1.0 - 0.55 * dot(d, d); colour = vec4(display(c) + dither(), 1.0); }\n";

static const char *const view_lit_vertex =
    VIEW_GLSL
    "layout(location = 0) in vec3 at; layout(location = 1) in vec3 normal; layout(location = 2) in vec3 reference;\n"
    "layout(location = 3) in vec2 kind_shade; layout(location = 4) in vec2 mottle;\n"
    "uniform mat4 to_clip, to_light; uniform float grain_m;\n"
    "out vec3 world, n, ref; out vec4 light; out vec4 misc;\n"
    "void main() {\n"
    "  gl_Position = to_clip * vec4(at, 1.0); world = at; n = normal; ref = reference / grain_m;\n"
    "  light = to_light * vec4(at, 1.0);\n"
    "  misc = vec4(kind_shade, mottle); }\n";

#define VIEW_LIGHTING VIEW_DISPLAY                                                                            \
    "in vec3 world, n, ref; in vec4 light; in vec4 misc; out vec4 colour;\n"                                  \
    "uniform vec3 eye, key, fill, up; uniform sampler2DShadow shadow; uniform float texel;\n"                 \
    "float lit(vec3 N) {\n"                                                                                   \
    "  float nl = dot(N, key); vec3 p = light.xyz * 0.5 + 0.5; p.z -= 0.003 + 0.006 * (1.0 - max(nl, 0.0)); float s = 0.0;\n" \
    "  s += texture(shadow, p + vec3(-0.5, -0.4, 0) * texel); s += texture(shadow, p + vec3(0.5, 0.4, 0) * texel); return s * 0.5 * smoothstep(0.0, 0.2, nl); }\n" \
    "float gloss(vec3 N, vec3 V, vec3 L, float a) { vec3 H = normalize(V + L); float nh = max(dot(N, H), 0.0), a2 = a * a, d = nh * nh * (a2 - 1.0) + 1.0;\n" \
    "  float lh = max(dot(L, H), 0.1); return max(dot(N, L), 0.0) * a2 / (4.0 * 3.14159 * d * d * lh * lh * (a + 0.5)); }\n" \
    "vec3 room(vec3 d) { float h = dot(d, up); vec3 c = mix(vec3(0.10, 0.09, 0.09), vec3(0.30, 0.34, 0.38), smoothstep(-0.4, 0.8, h));\n" \
    "  c += vec3(1.9, 1.85, 1.75) * smoothstep(0.90, 0.965, dot(d, key)); c += vec3(0.5, 0.6, 0.75) * smoothstep(0.80, 0.95, dot(d, fill)); return c; }\n" \
    "vec3 film(vec3 c) { c *= 1.05; c = c * (2.51 * c + 0.03) / (c * (2.43 * c + 0.59) + 0.14); return display(c); }\n"

/* Wet tissue: light scatters past the terminator, red farthest; a thin film of water reflects the lamps. */
static const char *const view_tissue_fragment =
    VIEW_GLSL VIEW_NOISE VIEW_LIGHTING
    "uniform vec4 tint[64];\n"
    "void main() {\n"
    "  float kind = floor(misc.x + 0.5), opened = mod(kind, 2.0); vec4 own = tint[int(kind * 0.5)];\n"
    "  vec4 fine = noise(ref * mix(0.9, 1.5, opened)), coarse = noise(ref * 0.27 + 3.1);\n"
    "  vec3 V = normalize(eye - world), N0 = normalize(n); if (dot(N0, V) < 0.0) N0 = -N0;\n"
    "  vec3 g = fine.yzw * mix(0.055, 0.16, opened) + coarse.yzw * 0.05; vec3 N = normalize(N0 - (g - dot(g, N0) * N0));\n"
    "  vec3 skin = mix(vec3(0.066, 0.011, 0.0085), vec3(0.138, 0.026, 0.018), smoothstep(0.25, 0.75, misc.z));\n"
    "  skin = mix(skin, vec3(0.14, 0.034, 0.016), 0.4 * smoothstep(0.5, 0.85, misc.w)) * (0.92 + 0.16 * fine.x);\n"
    "  vec3 flesh = mix(vec3(0.36, 0.045, 0.032), vec3(0.52, 0.12, 0.085), smoothstep(0.3, 0.75, fine.x)); flesh = mix(flesh, vec3(0.24, 0.014, 0.012), 0.8 * smoothstep(0.55, 0.8, coarse.x));\n"
    "  vec3 albedo = mix(skin, flesh, opened); albedo = mix(albedo, own.rgb * mix(0.75 + 0.35 * misc.z + 0.2 * fine.x, 0.95 + 0.5 * fine.x - 0.3 * coarse.x, opened), own.a);\n"
    "  float s = lit(N0), nl = dot(N, key), wetness = mix(1.0, 0.55, opened) * (0.75 + 0.5 * coarse.x);\n"
    "  vec3 wrap = vec3(0.36, 0.12, 0.09);\n"
    "  vec3 diffuse = clamp((vec3(nl) + wrap) / (1.0 + wrap), 0.0, 1.0) * mix(vec3(0.16, 0.05, 0.04), vec3(1.0), s) * vec3(1.75, 1.70, 1.60);\n"
    "  diffuse += clamp((vec3(dot(N, fill)) + wrap) / (1.0 + wrap), 0.0, 1.0) * vec3(0.42, 0.47, 0.55);\n"
    "  float h = dot(N, up) * 0.5 + 0.5; diffuse += mix(vec3(0.16, 0.12, 0.115), vec3(0.40, 0.42, 0.45), h) * misc.y;\n"
    "  float nv = max(dot(N, V), 0.0), fresnel = 0.03 + 0.62 * pow(1.0 - nv, 5.0);\n"
    "  vec3 c = albedo * diffuse * mix(1.0, misc.y, 0.5);\n"
    "  c += wetness * misc.y * fresnel * room(reflect(-V, N)) * mix(0.35, 1.0, s);\n"
    "  c += wetness * s * 0.05 * (gloss(N, V, key, 0.10) + 0.8 * gloss(N, V, key, 0.32)) * vec3(1.9);\n"
    "  c += wetness * 0.035 * gloss(N, V, fill, 0.16) * vec3(0.9, 1.0, 1.15);\n"
    "  colour = vec4(film(c), 1.0); }\n";

/* Instruments. The hot electrode and the arrows emit light. */
static const char *const view_metal_fragment =
    VIEW_GLSL VIEW_NOISE VIEW_LIGHTING
    "void main() {\n"
    "  vec3 V = normalize(eye - world), N = normalize(n); if (dot(N, V) < 0.0) N = -N;\n"
    "  float kind = floor(misc.x + 0.5), s = lit(N), nl = max(dot(N, key), 0.0), nf = max(dot(N, fill), 0.0), nv = max(dot(N, V), 0.0);\n"
    "  vec3 albedo = vec3(0.0), f0 = vec3(0.04), glow = vec3(0.0); float a = 0.25;\n"
    "  if (kind < 2.5) { albedo = vec3(0.06); f0 = vec3(0.56, 0.57, 0.58); a = 0.22; }\n"
    "  else if (kind < 3.5) { albedo = vec3(0.040, 0.043, 0.050); f0 = vec3(0.05); a = 0.26; }\n"
    "  else if (kind < 4.5) { albedo = vec3(0.2, 0.05, 0.02); glow = mix(vec3(1.5, 0.28, 0.03), vec3(2.6, 1.15, 0.30), nv); }\n"
    "  else if (kind < 5.5) { albedo = vec3(0.55, 0.58, 0.62); f0 = vec3(0.05); a = 0.35; }\n"
    "  else if (kind < 6.5) { albedo = vec3(0.62, 0.27, 0.012); glow = albedo * 0.30; }\n"
    "  else if (kind < 7.5) { albedo = vec3(0.02, 0.24, 0.52); glow = albedo * 0.30; }\n"
    "  else if (kind < 8.5) { albedo = vec3(0.012, 0.26, 0.15); glow = albedo * 0.20; }\n"
    "  else if (kind < 9.5) { albedo = vec3(0.40, 0.35, 0.22); glow = albedo * 0.10; }\n"
    "  else { albedo = vec3(0.52, 0.33, 0.17); glow = albedo * 0.08; a = 0.3; }\n"
    "  if (kind > 5.5) s = 1.0;\n"
    "  vec3 c = albedo * (nl * s * 2.6 + nf * 0.5 + 0.30 * (dot(N, up) * 0.5 + 0.5) + 0.12) + glow;\n"
    "  vec3 F = f0 + (1.0 - f0) * pow(1.0 - nv, 5.0) * 0.5;\n"
    "  c += F * room(reflect(-V, N)) * mix(0.5, 1.0, s) + f0 * s * gloss(N, V, key, a) * 2.6;\n"
    "  colour = vec4(film(c), 1.0); }\n";

static const char *const view_floor_vertex =
    VIEW_GLSL "out vec3 world; out vec2 spot; uniform vec3 middle, across, along; uniform mat4 to_clip; uniform float size, spot_size;\n"
    "void main() { vec2 p = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0; world = middle + size * (p.x * across + p.y * along);\n"
    "  spot = p * size / spot_size * 0.5 + 0.5; gl_Position = to_clip * vec4(world, 1.0); }\n";
/* A surgical drape that fades into the background. */
static const char *const view_floor_fragment =
    VIEW_GLSL VIEW_DISPLAY
    "in vec3 world; in vec2 spot; out vec4 colour; uniform vec3 eye, middle, up, low, high; uniform sampler2D key_spot, sky_spot; uniform float radius; uniform vec2 screen;\n"
    "void main() {\n"
    "  float away = length(world - middle) / radius; vec2 q = clamp(spot, 0.0, 1.0);\n"
    "  float inside = step(abs(spot.x - 0.5), 0.5) * step(abs(spot.y - 0.5), 0.5);\n"
    "  float k = inside * texture(key_spot, q).r, a = inside * texture(sky_spot, q).r;\n"
    "  vec3 drape = vec3(0.030, 0.088, 0.098);\n"
    "  vec3 c = drape * (1.45 * (1.0 - 0.82 * k) + 0.55 * (1.0 - 0.85 * a));\n"
    "  c *= exp(-0.10 * away * away);\n"
    "  vec2 uv = gl_FragCoord.xy / screen; vec3 sky = mix(low, high, uv.y); vec2 d = uv - 0.5; sky *= 1.0 - 0.55 * dot(d, d);\n"
    "  c = mix(c, sky, smoothstep(1.6, 6.0, away)); colour = vec4(display(c) + dither(), 1.0); }\n";

#endif
