(function viewer() {
  const points = run.points, canvas = one("points");
  if (!points) return;
  one("view").hidden = false;
  const gl = canvas.getContext("webgl", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) { one("sample").textContent = "This browser has no WebGL: the particles cannot be shown."; canvas.dataset.state = "no webgl"; return; }
  const n = points.shown;
  one("sample").textContent = (n < points.total ? `${n} of ${points.total} particles.` : `${n} particles.`) +
    " Drag to turn, with the right button to move, wheel to come closer, double click to return.";

  const program = gl.createProgram();
  const compile = (type, source) => {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  };
  compile(gl.VERTEX_SHADER, `
    attribute float x, y, z, value;
    uniform vec3 low, size;
    uniform mat4 view;
    uniform vec2 lens;   // tangents of half the angle of view
    uniform float radius, pixels;
    varying float shade;
    void main() {
      vec4 p = view * vec4(low + size * vec3(x, y, z), 1.0);
      float depth = max(-p.z, 1e-6 * length(size));
      float near = 0.01 * length(size), far = 20.0 * length(size);
      gl_Position = vec4(p.x / lens.x, p.y / lens.y, depth * (far + near) / (far - near) - 2.0 * far * near / (far - near), depth);
      gl_PointSize = clamp(pixels * radius / (lens.y * depth), 1.5, 60.0);
      shade = value;
    }`);
  compile(gl.FRAGMENT_SHADER, `
    precision mediump float;
    uniform sampler2D palette;
    varying float shade;
    void main() {
      vec2 p = 2.0 * gl_PointCoord - 1.0;
      float r = dot(p, p);
      if (r > 1.0) discard;
      vec3 normal = vec3(p.x, -p.y, sqrt(1.0 - r));
      float light = 0.45 + 0.6 * max(dot(normal, normalize(vec3(0.4, 0.7, 0.8))), 0.0);
      gl_FragColor = vec4(texture2D(palette, vec2((shade * 255.0 + 0.5) / 256.0, 0.5)).rgb * light, 1.0);
    }`);
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  gl.useProgram(program);
  const uniform = name => gl.getUniformLocation(program, name), attribute = name => gl.getAttribLocation(program, name);

  // y is up in the view; a scene whose gravity is along z is turned to that
  const gravity = /^gravity = \[([^\]]*)\]/m.exec(run.scene || ""), g = gravity ? gravity[1].split(",").map(Number) : [];
  const upright = Math.abs(g[2] || 0) > Math.abs(g[1] || 0);

  // viridis of Matplotlib, through ten of its colours; and Okabe & Ito's for numbers, grey for none
  const viridis = [[68, 1, 84], [72, 40, 120], [62, 73, 137], [49, 104, 142], [38, 130, 142], [31, 158, 137], [53, 183, 121], [110, 206, 88], [181, 222, 43], [253, 231, 37]];
  const numbered = [[0, 114, 178], [230, 159, 0], [0, 158, 115], [213, 94, 0], [86, 180, 233], [204, 121, 167], [240, 228, 66], [120, 120, 120]];
  const color = (k, ofNumbers) => {
    if (ofNumbers) return k === 255 ? [90, 90, 90] : numbered[k % numbered.length];
    const at = k / 255 * (viridis.length - 1), i = Math.min(Math.floor(at), viridis.length - 2);
    return [0, 1, 2].map(c => viridis[i][c] + (at - i) * (viridis[i + 1][c] - viridis[i][c]));
  };
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);

  const frames = points.frames.map(f => ({ index: f.index, time: f.time, data: f.data, bytes: null }));
  const bytesOf = frame => {
    if (!frame.bytes) { frame.bytes = Uint8Array.from(atob(frame.data), c => c.charCodeAt(0)); frame.data = null; }
    return frame.bytes;
  };
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  let current = 0, shown = 0;
  const select = one("attribute");
  points.attributes.forEach((a, k) => select.append(element("option", { value: k }, a.name + (a.unit ? ` (${a.unit})` : ""))));

  function legend() {
    const a = points.attributes[shown];
    const bytes = new Uint8Array(256 * 3);
    for (let k = 0; k < 256; k++) bytes.set(color(k, a.numbered), 3 * k);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, 256, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, bytes);
    const css = c => `rgb(${c.map(Math.round)})`;
    const bar = a.numbered ? numbered.map((c, i) => `${css(c)} ${12.5 * i}% ${12.5 * (i + 1)}%`) : viridis.map(css);
    const names = a.numbered ? (a.name === "body" ? ["", points.bodies.slice(0, 8).join(", ")] : ["0", "7, 8 as 0; grey: none"]) : [short(a.least), short(a.most)];
    one("legend").replaceChildren(names[0], element("i", { style: `background:linear-gradient(to right,${bar.join(",")})` }), names[1]);
  }
  function load() {
    const frame = frames[current];
    gl.bufferData(gl.ARRAY_BUFFER, bytesOf(frame), gl.DYNAMIC_DRAW);
    one("instant").textContent = `frame ${frame.index}, t = ${short(frame.time)} s`;
    one("time").value = current;
  }

  const size = points.low.map((l, a) => Math.max(points.high[a] - l, 1e-9)), middle = points.low.map((l, a) => l + size[a] / 2);
  const reach = Math.hypot(...size), flat = !upright && size[2] < 1e-3 * reach;
  let eye;
  const home = () => { eye = { turn: flat ? 0 : 0.6, lift: flat ? 0 : 0.35, distance: 1.15 * reach, target: middle.slice() }; };
  home();
  const axes = () => {
    const [ct, st, cl, sl] = [Math.cos(eye.turn), Math.sin(eye.turn), Math.cos(eye.lift), Math.sin(eye.lift)];
    const turned = v => upright ? [v[0], -v[2], v[1]] : v;
    return { right: turned([ct, 0, -st]), up: turned([-st * sl, cl, -ct * sl]), back: turned([st * cl, sl, ct * cl]) };
  };
  function draw() {
    const scale = window.devicePixelRatio || 1;
    const [w, h] = [Math.round(canvas.clientWidth * scale), Math.round(canvas.clientHeight * scale)];
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    gl.viewport(0, 0, w, h);
    gl.clearColor(0.106, 0.118, 0.137, 1);
    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const { right, up, back } = axes(), dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const at = eye.target.map((t, a) => t + eye.distance * back[a]);
    gl.uniformMatrix4fv(uniform("view"), false, [right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
                                                 -dot(right, at), -dot(up, at), -dot(back, at), 1]);
    const tangent = 0.42;
    gl.uniform2f(uniform("lens"), tangent * w / h, tangent);
    gl.uniform3fv(uniform("low"), points.low);
    gl.uniform3fv(uniform("size"), size);
    gl.uniform1f(uniform("radius"), 1.25 * points.radius * Math.cbrt(points.total / n));
    gl.uniform1f(uniform("pixels"), h);
    ["x", "y", "z"].forEach((name, a) => {
      gl.enableVertexAttribArray(attribute(name));
      gl.vertexAttribPointer(attribute(name), 1, gl.UNSIGNED_SHORT, true, 2, 2 * a * n);
    });
    gl.enableVertexAttribArray(attribute("value"));
    gl.vertexAttribPointer(attribute("value"), 1, gl.UNSIGNED_BYTE, true, 1, 6 * n + shown * n);
    gl.drawArrays(gl.POINTS, 0, n);
    canvas.dataset.frame = frames[current].index;
  }
  let asked = false;
  const redraw = () => { if (!asked) { asked = true; requestAnimationFrame(() => { asked = false; draw(); }); } };

  one("time").max = frames.length - 1;
  one("time").addEventListener("input", e => { current = +e.target.value; load(); redraw(); });
  select.addEventListener("change", () => { shown = +select.value; legend(); redraw(); });
  let playing = null;
  one("play").addEventListener("click", () => {
    one("play").textContent = playing ? "play" : "stop";
    if (playing) { clearInterval(playing); playing = null; return; }
    playing = setInterval(() => { current = (current + 1) % frames.length; load(); redraw(); }, 1000 / 15);
  });
  let held = null;
  canvas.addEventListener("pointerdown", e => { held = { x: e.clientX, y: e.clientY, move: e.button === 2 || e.shiftKey }; canvas.setPointerCapture(e.pointerId); });
  canvas.addEventListener("pointerup", () => { held = null; });
  canvas.addEventListener("pointermove", e => {
    if (!held) return;
    const [dx, dy] = [e.clientX - held.x, e.clientY - held.y];
    [held.x, held.y] = [e.clientX, e.clientY];
    if (held.move || flat) {
      const { right, up } = axes(), per = 0.84 * eye.distance / canvas.clientHeight;
      eye.target = eye.target.map((t, a) => t - per * (dx * right[a] - dy * up[a]));
    } else {
      eye.turn -= 0.008 * dx;
      eye.lift = Math.max(-1.5, Math.min(1.5, eye.lift + 0.008 * dy));
    }
    redraw();
  });
  canvas.addEventListener("contextmenu", e => e.preventDefault());
  canvas.addEventListener("wheel", e => { e.preventDefault(); eye.distance *= Math.exp(0.001 * e.deltaY); redraw(); }, { passive: false });
  canvas.addEventListener("dblclick", () => { home(); redraw(); });
  window.addEventListener("resize", redraw);

  // where nothing is damaged there is more to see of how it moves
  if (points.attributes[0].name === "damage" && !table.maximum_damage.some(d => d > 0))
    shown = points.attributes.findIndex(a => a.name === "speed");
  select.value = shown;
  current = frames.length - 1;
  legend();
  load();
  draw();
  // What is on the canvas, for whoever checks the page.
  const pixels = new Uint8Array(4 * canvas.width * canvas.height);
  gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  let covered = 0;
  for (let i = 0; i < pixels.length; i += 4) if (Math.abs(pixels[i] - 27) + Math.abs(pixels[i + 1] - 30) + Math.abs(pixels[i + 2] - 35) > 12) covered++;
  Object.assign(canvas.dataset, { state: gl.getError() === gl.NO_ERROR ? "drawn" : "error", points: n, covered: (4 * covered / pixels.length).toFixed(4) });
})();
