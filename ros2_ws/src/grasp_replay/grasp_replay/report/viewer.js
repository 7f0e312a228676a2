// SPDX-License-Identifier: Apache-2.0
// Turnable rows: one hidden WebGL canvas draws every row, each row shows its picture on a plain
// canvas, so that any number of rows costs one context. Without WebGL the printed pictures stay.
(function () {
  'use strict';
  const rows = JSON.parse(document.getElementById('rows').textContent);
  const gl = document.createElement('canvas');
  const g = gl.getContext('webgl', { antialias: true, preserveDrawingBuffer: true });
  if (!g) { document.body.classList.add('no-webgl'); return; }
  g.getExtension('OES_element_index_uint');

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const compile = (kind, text) => {
    const shader = g.createShader(kind);
    g.shaderSource(shader, text);
    g.compileShader(shader);
    if (!g.getShaderParameter(shader, g.COMPILE_STATUS)) throw new Error(g.getShaderInfoLog(shader));
    return shader;
  };
  // `morph` goes from rest (0) to loaded (1); colours are unlit, shade is for the shape only.
  const program = g.createProgram();
  g.attachShader(program, compile(g.VERTEX_SHADER, `
    attribute vec3 rest, place; attribute float value;
    uniform mat3 turn; uniform vec3 centre; uniform float morph, zoom, aspect, lift;
    varying float v, seen; varying vec3 world;
    void main() {
      vec3 p = turn * (mix(rest, place, morph) - centre) * zoom;
      // Not seen counts for nothing: v / seen interpolates over the seen corners only.
      seen = value > 254.5 ? 0.0 : 1.0; v = value * seen; world = p;
      gl_PointSize = 2.0;
      gl_Position = vec4(p.x / aspect, p.y, -p.z * 0.25 - lift, 1.0);
    }`));
  g.attachShader(program, compile(g.FRAGMENT_SHADER, `
    #extension GL_OES_standard_derivatives : enable
    precision highp float;
    uniform sampler2D table; uniform vec4 flat_colour; uniform float shade;
    varying float v, seen; varying vec3 world;
    void main() {
      if (flat_colour.a > 0.0) { gl_FragColor = flat_colour; return; }
      float step_ = seen < 0.5 ? 255.0 : min(floor(v / seen + 0.5), 254.0);
      vec3 c = texture2D(table, vec2((step_ + 0.5) / 256.0, 0.5)).rgb;
      if (!gl_FrontFacing) c = vec3(0.45);
      #ifdef GL_OES_standard_derivatives
      vec3 n = normalize(cross(dFdx(world), dFdy(world)));
      c *= mix(1.0, 0.35 + 0.65 * clamp(dot(n, normalize(vec3(-0.4, 0.5, 0.8))), 0.0, 1.0), shade);
      #endif
      gl_FragColor = vec4(c, 1.0);
    }`));
  g.getExtension('OES_standard_derivatives');
  g.linkProgram(program);
  if (!g.getProgramParameter(program, g.LINK_STATUS)) throw new Error(g.getProgramInfoLog(program));
  g.useProgram(program);
  const uniform = (name) => g.getUniformLocation(program, name);
  const U = Object.fromEntries(
    ['turn', 'centre', 'morph', 'zoom', 'aspect', 'lift', 'table', 'flat_colour', 'shade']
      .map((name) => [name, uniform(name)]));
  const A = Object.fromEntries(
    ['rest', 'place', 'value'].map((name) => [name, g.getAttribLocation(program, name)]));
  const colours = bytes(document.getElementById('colours').textContent);
  g.bindTexture(g.TEXTURE_2D, g.createTexture());
  g.pixelStorei(g.UNPACK_ALIGNMENT, 1);
  g.texImage2D(g.TEXTURE_2D, 0, g.RGB, 256, 1, 0, g.RGB, g.UNSIGNED_BYTE, colours);
  for (const [name, mode] of [['MIN_FILTER', g.NEAREST], ['MAG_FILTER', g.NEAREST],
    ['WRAP_S', g.CLAMP_TO_EDGE], ['WRAP_T', g.CLAMP_TO_EDGE]]) {
    g.texParameteri(g.TEXTURE_2D, g['TEXTURE_' + name], mode);
  }

  const buffer = (target, data) => {
    const made = g.createBuffer();
    g.bindBuffer(target, made);
    g.bufferData(target, data, g.STATIC_DRAW);
    return made;
  };
  const attribute = (name, data, size, type, scaled) => {
    if (A[name] < 0) return;
    g.bindBuffer(g.ARRAY_BUFFER, data);
    g.enableVertexAttribArray(A[name]);
    g.vertexAttribPointer(A[name], size, type, scaled, 0, 0);
  };

  class Row {
    constructor(data) {
      this.data = data;
      const figure = document.getElementById('turn-' + data.key);
      this.canvas = figure.querySelector('canvas');
      this.controls = figure.querySelectorAll('select, input');
      this.legend = figure.querySelector('.legend-text');
      this.buffers = null;
      this.zoom = 2.0;
      const c = data.camera;
      this.turn = [c[0], c[3], c[6], c[1], c[4], c[7], c[2], c[5], c[8]]; // columns
      this.fingers = new Map();
      this.listen();
      new ResizeObserver(() => this.draw()).observe(this.canvas);
    }
    value(name) {
      const control = [...this.controls].find((one) => one.name === name);
      return control.type === 'checkbox' ? control.checked : control.value;
    }
    load() {
      const d = this.data;
      const wide = d.index === 4;
      const many = (text) => (wide ? new Uint32Array(bytes(text).buffer)
        : new Uint16Array(bytes(text).buffer));
      const positions = Object.fromEntries(Object.entries(d.shapes).map(
        ([name, text]) => [name, buffer(g.ARRAY_BUFFER, bytes(text))]));
      const scalar = (group) => Object.fromEntries(Object.entries(d[group]).map(
        ([name, text]) => [name, buffer(g.ARRAY_BUFFER, bytes(text))]));
      const triangles = many(d.triangles), scan = bytes(d.scan);
      const seen = new Set(), pairs = [];
      for (let k = 0; k < triangles.length; k += 3) {
        for (const [i, j] of [[0, 1], [1, 2], [2, 0]]) {
          const a = Math.min(triangles[k + i], triangles[k + j]);
          const b = Math.max(triangles[k + i], triangles[k + j]);
          const name = a * 4294967296 + b;
          if (!seen.has(name)) { seen.add(name); pairs.push(a, b); }
        }
      }
      const edges = wide ? new Uint32Array(pairs) : new Uint16Array(pairs);
      this.buffers = {
        positions, error: scalar('error'), displacement: scalar('displacement'),
        scan: buffer(g.ARRAY_BUFFER, scan), scanCount: scan.length / 6,
        triangles: buffer(g.ELEMENT_ARRAY_BUFFER, triangles), triangleCount: triangles.length,
        edges: buffer(g.ELEMENT_ARRAY_BUFFER, edges), edgeCount: edges.length,
        type: wide ? g.UNSIGNED_INT : g.UNSIGNED_SHORT,
      };
    }
    draw() {
      const ratio = Math.min(window.devicePixelRatio || 1, 2);
      const w = Math.round(this.canvas.clientWidth * ratio);
      const h = Math.round(this.canvas.clientHeight * ratio);
      if (!w || !h) return;
      if (!this.buffers) this.load();
      gl.width = w; gl.height = h;
      this.canvas.width = w; this.canvas.height = h;
      g.viewport(0, 0, w, h);
      g.clearColor(1, 1, 1, 1);
      g.clear(g.COLOR_BUFFER_BIT | g.DEPTH_BUFFER_BIT);
      g.enable(g.DEPTH_TEST);
      const b = this.buffers, d = this.data;
      const shape = this.value('surface'), group = this.value('colour');
      const top = group === 'error' ? d.errorTop[shape] : d.displacementTop;
      this.legend.querySelector('.top').textContent = (top * 1e3).toFixed(2) + ' mm';
      g.uniformMatrix3fv(U.turn, false, this.turn);
      g.uniform3fv(U.centre, d.centre);
      g.uniform1f(U.zoom, this.zoom);
      g.uniform1f(U.aspect, w / h);
      g.uniform1f(U.shade, this.value('shade') ? 1 : 0);
      g.uniform1f(U.morph, Number(this.value('load')) / 100);
      g.uniform1i(U.table, 0);
      attribute('rest', b.positions.rest, 3, g.UNSIGNED_SHORT, true);
      attribute('place', b.positions[shape], 3, g.UNSIGNED_SHORT, true);
      attribute('value', b[group][shape], 1, g.UNSIGNED_BYTE, false);
      g.uniform4f(U.flat_colour, 0, 0, 0, 0);
      g.uniform1f(U.lift, 0);
      g.bindBuffer(g.ELEMENT_ARRAY_BUFFER, b.triangles);
      g.drawElements(g.TRIANGLES, b.triangleCount, b.type, 0);
      g.enable(g.BLEND);
      g.blendFunc(g.SRC_ALPHA, g.ONE_MINUS_SRC_ALPHA);
      g.uniform1f(U.lift, 0.0008);
      if (this.value('edges')) {
        g.uniform4f(U.flat_colour, 0, 0, 0, 0.16);
        g.bindBuffer(g.ELEMENT_ARRAY_BUFFER, b.edges);
        g.drawElements(g.LINES, b.edgeCount, b.type, 0);
      }
      if (this.value('scan')) {
        attribute('rest', b.scan, 3, g.UNSIGNED_SHORT, true);
        attribute('place', b.scan, 3, g.UNSIGNED_SHORT, true);
        g.disableVertexAttribArray(A.value);
        g.uniform4f(U.flat_colour, 0.75, 0.1, 0.1, 0.9);
        g.drawArrays(g.POINTS, 0, b.scanCount);
      }
      g.disable(g.BLEND);
      this.canvas.getContext('2d').drawImage(gl, 0, 0);
    }
    rotate(dx, dy) {
      const t = this.turn;
      const spin = (i, j, angle) => {
        const c = Math.cos(angle), s = Math.sin(angle);
        for (let k = 0; k < 3; k += 1) {
          const a = t[3 * k + i], b = t[3 * k + j];
          t[3 * k + i] = c * a - s * b;
          t[3 * k + j] = s * a + c * b;
        }
      };
      spin(2, 0, dx);
      spin(1, 2, dy);
    }
    listen() {
      const again = () => requestAnimationFrame(() => this.draw());
      this.controls.forEach((one) => one.addEventListener('input', again));
      const c = this.canvas;
      c.addEventListener('pointerdown', (e) => {
        c.setPointerCapture(e.pointerId);
        this.fingers.set(e.pointerId, [e.clientX, e.clientY]);
      });
      c.addEventListener('pointermove', (e) => {
        const last = this.fingers.get(e.pointerId);
        if (!last) return;
        const now = [e.clientX, e.clientY];
        if (this.fingers.size === 1) {
          this.rotate((now[0] - last[0]) * 0.01, (now[1] - last[1]) * 0.01);
        } else {
          const other = [...this.fingers].find(([id]) => id !== e.pointerId)[1];
          const gap = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
          this.zoom = Math.min(8, Math.max(0.5, this.zoom * gap(now) / gap(last)));
        }
        this.fingers.set(e.pointerId, now);
        again();
      });
      for (const name of ['pointerup', 'pointercancel']) {
        c.addEventListener(name, (e) => this.fingers.delete(e.pointerId));
      }
      c.addEventListener('wheel', (e) => {
        e.preventDefault();
        this.zoom = Math.min(8, Math.max(0.5, this.zoom * Math.exp(-e.deltaY * 0.001)));
        again();
      }, { passive: false });
    }
  }
  window.reportRows = rows.map((data) => new Row(data));
  window.reportRows.forEach((row) => row.draw());
  document.body.classList.add('webgl');
}());
