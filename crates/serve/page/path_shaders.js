// Shader programs of the path view.
//
// Invariant: the state of a piece of path follows from its record alone, compared with records in uniforms. While the
// machine moves, nothing is uploaded but these uniforms.

// `along` is the record relative to the cursor, and runs along each segment; the kind is that of the segment's end,
// which is the provoking vertex.
const VERTEX = `#version 300 es
precision highp float; precision highp int;
layout(location=0) in vec3 point_a; layout(location=1) in uint mark_a;
layout(location=2) in vec3 point_b; layout(location=3) in uint mark_b;
uniform vec3 right, up;
uniform vec2 offset, picture;
uniform float width;
uniform int cursor;
out float along;
flat out uint kind;
flat out vec2 end_pixel;
vec2 project(vec3 point) { return vec2(dot(right, point), dot(up, point)) + offset; }
float record(uint mark) { return float(int(mark & 0x3fffffffu) - cursor); }
void main() {
  vec2 a = project(point_a);
  if (width > 0.0) {
    vec2 b = project(point_b), d = (b - a) * picture;
    float l = length(d);
    vec2 t = l > 0.0 ? d / l : vec2(1.0, 0.0), s = vec2(-t.y, t.x);
    bool is_end = gl_VertexID > 1;
    float side = float(gl_VertexID & 1) * 2.0 - 1.0;
    vec2 shift = (s * side + t * (is_end ? 0.5 : -0.5)) * width / picture;
    gl_Position = vec4((is_end ? b : a) + shift, 0.0, 1.0);
    along = record(is_end ? mark_b : mark_a);
    kind = mark_b >> 30;
    end_pixel = (b + 1.0) * picture * 0.5;
  } else {
    gl_Position = vec4(a, 0.0, 1.0);
    along = record(mark_a);
    kind = mark_a >> 30;
    end_pixel = (a + 1.0) * picture * 0.5;
  }
}`;

const INK = `#version 300 es
precision highp float; precision highp int;
in float along;
flat in uint kind;
flat in vec2 end_pixel;
uniform vec2 history;          // oldest and reached, relative to the cursor
uniform vec2 only;             // range that is drawn
uniform vec4 ink[6];           // planned, cut, retraced, before the history, rapid, paper; alpha 0 for none
uniform vec4 only_ink;         // colour of the range, if its alpha is not 0,
uniform float only_from;       // from this record on,
uniform float only_dash;       // in dashes of so many records with their gaps, if it is not 0
uniform float dash, feed_share;
out vec4 colour;
void main() {
  if (along < only.x || along > only.y) discard;
  vec4 c = along > history.y ? ink[0] : along > 0.0 ? ink[2] : along < history.x ? ink[3] : ink[1];
  if (kind == 0u) {
    if (mod(length(gl_FragCoord.xy - end_pixel), dash) > dash * 0.5) discard;
    c = along > 0.0 && along <= history.y ? c : ink[4];
  } else if (kind == 1u) c = mix(c, ink[5], feed_share);
  if (c.a == 0.0) discard;
  colour = only_ink.a > 0.0 && along >= only_from ? only_ink : c;
  if (only_dash > 0.0 && mod(along - only.x, only_dash) > only_dash * 0.5) colour = ink[5];
}`;

const PICK = `#version 300 es
precision highp float; precision highp int;
in float along;
flat in uint kind;
flat in vec2 end_pixel;
uniform int cursor;
out uvec4 number;
void main() { number = uvec4(uint(max(int(round(along)) + cursor, 0)) + 1u, 0u, 0u, 0u); }`;

const UNIFORMS = [
  'right',
  'up',
  'offset',
  'picture',
  'width',
  'cursor',
  'history',
  'only',
  'ink',
  'only_ink',
  'only_from',
  'only_dash',
  'dash',
  'feed_share',
];

function link(gl, vertexText, fragmentText) {
  const program = gl.createProgram();
  for (const [kind, text] of [
    [gl.VERTEX_SHADER, vertexText],
    [gl.FRAGMENT_SHADER, fragmentText],
  ]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader) ?? 'shader');
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? 'program');
  const uniforms = Object.fromEntries(UNIFORMS.map(name => [name, gl.getUniformLocation(program, name)]));
  return { program, uniforms };
}

/** Makes the programs: `ink` draws colours, `pick` records. */
export function makePrograms(gl) {
  return { ink: link(gl, VERTEX, INK), pick: link(gl, VERTEX, PICK) };
}
