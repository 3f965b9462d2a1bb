/* Reading values from the charts, one time for all of them, and the moving skeleton.
   Charts carry their own scales (data-place, data-range); nothing is drawn twice. */
"use strict";
(() => {
  /** Show what an address leads to, although its section is folded. */
  function unfold() {
    const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!target) return;
    for (const fold of target.querySelectorAll(":scope > details.fold")) fold.open = true;
    target.scrollIntoView();
  }
  addEventListener("hashchange", unfold);
  addEventListener("load", unfold);

  const SVG = "http://www.w3.org/2000/svg";
  const listeners = [];
  let now = NaN;

  /** Set the time that all charts and the skeleton share [s]; NaN for none. */
  function setTime(time, source) {
    now = time;
    for (const listener of listeners) listener(time, source);
  }

  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const numbers = (text) => text.trim().split(/\s+/).map(Number);
  const digits = (value, span) => {
    if (!isFinite(value)) return "–";
    const places = Math.max(0, Math.min(9, 2 - Math.floor(Math.log10(Math.abs(span) || 1))));
    return value.toFixed(places).replace(/^-(?=[0.]*$)/, "").replace("-", "−");
  };

  const reading = document.createElement("div");
  reading.className = "reading";
  reading.hidden = true;
  document.body.append(reading);

  function show(event, lines) {
    reading.replaceChildren(...lines.map((line) => Object.assign(document.createElement("div"), { textContent: line })));
    reading.hidden = false;
    const box = reading.getBoundingClientRect();
    const left = event.clientX + 14 + box.width > innerWidth ? event.clientX - 14 - box.width : event.clientX + 14;
    reading.style.left = `${left}px`;
    reading.style.top = `${Math.min(event.clientY + 12, innerHeight - box.height - 4)}px`;
  }

  /** Place of a pointer in the drawing's own units. */
  function local(svg, event) {
    const box = svg.getBoundingClientRect();
    const view = svg.viewBox.baseVal;
    return [((event.clientX - box.left) / box.width) * view.width, ((event.clientY - box.top) / box.height) * view.height];
  }

  /* Charts over time */

  class Chart {
    constructor(svg) {
      this.svg = svg;
      [this.left, this.top, this.right, this.bottom] = numbers(svg.dataset.place);
      [this.t0, this.t1, this.y0, this.y1] = numbers(svg.dataset.range);
      this.visible = false;
      this.lines = null;
      svg.addEventListener("pointermove", (event) => this.point(event));
      svg.addEventListener("pointerleave", () => {
        reading.hidden = true;
      });
    }

    /** Points of the drawn lines, read back once. */
    prepare() {
      if (this.lines) return;
      this.lines = [...this.svg.querySelectorAll("path.line[data-label]")].map((path) => {
        const flat = (path.getAttribute("d").match(/-?[\d.]+/g) || []).map(Number);
        const dot = document.createElementNS(SVG, "circle");
        dot.setAttribute("class", `dot ${path.getAttribute("class").replace("line", "")}`);
        dot.setAttribute("r", "3");
        return { flat, dot, label: path.dataset.label };
      });
      this.cursor = document.createElementNS(SVG, "path");
      this.cursor.setAttribute("class", "cursor");
      this.svg.append(this.cursor, ...this.lines.map((line) => line.dot));
    }

    /** Index of the point of a line nearest to a place along the chart, -1 where there is none near. */
    nearest(flat, x) {
      let low = 0;
      let high = flat.length / 2 - 1;
      if (high < 0) return -1;
      while (high - low > 1) {
        const middle = (low + high) >> 1;
        if (flat[2 * middle] <= x) low = middle;
        else high = middle;
      }
      const best = Math.abs(flat[2 * low] - x) <= Math.abs(flat[2 * high] - x) ? low : high;
      return Math.abs(flat[2 * best] - x) < 8 + (this.right - this.left) / 40 ? best : -1;
    }

    mark(time) {
      this.prepare();
      const outside = !(time >= this.t0 && time <= this.t1);
      this.cursor.style.display = outside ? "none" : "";
      const x = this.left + ((time - this.t0) / (this.t1 - this.t0)) * (this.right - this.left);
      if (!outside) this.cursor.setAttribute("d", `M${x} ${this.top}V${this.bottom}`);
      const values = [];
      for (const line of this.lines) {
        const best = outside ? -1 : this.nearest(line.flat, x);
        line.dot.style.display = best < 0 ? "none" : "";
        if (best < 0) continue;
        line.dot.setAttribute("cx", line.flat[2 * best]);
        line.dot.setAttribute("cy", line.flat[2 * best + 1]);
        const share = (this.bottom - line.flat[2 * best + 1]) / (this.bottom - this.top);
        values.push([line.label, this.y0 + share * (this.y1 - this.y0)]);
      }
      return values;
    }

    point(event) {
      const [x] = local(this.svg, event);
      const time = this.t0 + ((x - this.left) / (this.right - this.left)) * (this.t1 - this.t0);
      if (!(time >= this.t0 && time <= this.t1)) {
        reading.hidden = true;
        return;
      }
      setTime(time, this);
      const unit = this.svg.querySelector(".title .unit")?.textContent ?? "";
      const values = this.mark(time);
      const told = values.map(([label, value]) => `${label}: ${digits(value, this.y1 - this.y0)} ${/parts/.test(unit) ? "" : unit}`);
      show(event, [`${digits(time, this.t1 - this.t0)} ${this.svg.dataset.clock ?? "s"}`, ...told]);
    }
  }

  const charts = new Map([...document.querySelectorAll("svg.time")].map((svg) => [svg, new Chart(svg)]));
  const watcher = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      const chart = charts.get(entry.target);
      chart.visible = entry.isIntersecting;
      if (chart.visible && isFinite(now)) chart.mark(now);
    }
  });
  charts.forEach((chart, svg) => watcher.observe(svg));
  let waiting = false;
  listeners.push(() => {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      charts.forEach((chart) => {
        if (chart.visible) chart.mark(now);
      });
    });
  });

  /* Heat maps: a color of the picture names its value. */

  for (const svg of document.querySelectorAll("svg.heat")) {
    const peak = Number(svg.dataset.peak);
    const bar = svg.querySelector("image:not(.heat)");
    let scale = null;
    const pixels = new Map();
    const load = async (image) => {
      const picture = new Image();
      picture.src = image.getAttribute("href");
      await picture.decode();
      const canvas = document.createElement("canvas");
      [canvas.width, canvas.height] = [picture.naturalWidth, picture.naturalHeight];
      const context = canvas.getContext("2d", { willReadFrequently: true });
      context.drawImage(picture, 0, 0);
      return { width: canvas.width, height: canvas.height, data: context.getImageData(0, 0, canvas.width, canvas.height).data };
    };
    const key = (data, i) => (data[i] << 16) | (data[i + 1] << 8) | data[i + 2];
    for (const image of svg.querySelectorAll("image.heat")) {
      const [left, top, right, bottom] = numbers(image.dataset.place);
      const [t0, t1] = numbers(image.dataset.range);
      const names = image.dataset.names.split("|");
      image.addEventListener("pointermove", async (event) => {
        if (!scale) {
          const column = await load(bar);
          scale = new Map();
          for (let i = 0; i < 256; i++) scale.set(key(column.data, 4 * i), 255 - i);
        }
        if (!pixels.has(image)) pixels.set(image, await load(image));
        const { width, height, data } = pixels.get(image);
        const [x, y] = local(svg, event);
        const u = Math.min(width - 1, Math.max(0, Math.floor(((x - left) / (right - left)) * width)));
        const v = Math.min(height - 1, Math.max(0, Math.floor(((y - top) / (bottom - top)) * height)));
        const level = scale.get(key(data, 4 * (v * width + u))) ?? NaN;
        const time = t0 + ((x - left) / (right - left)) * (t1 - t0);
        setTime(time, svg);
        show(event, [`${digits(time, t1 - t0)} s`, `${names[v]}: ${digits((level / 255) * peak, peak)} ${svg.dataset.unit}`]);
      });
      image.addEventListener("pointerleave", () => {
        reading.hidden = true;
      });
    }
  }

  /* A figure as a file */

  const KEPT = ["fill", "stroke", "stroke-width", "stroke-dasharray", "stroke-linejoin", "opacity", "font-size", "font-weight", "font-family", "text-anchor", "paint-order"];

  /** A copy of a drawing with its styles written out. */
  function plain(svg) {
    const copy = svg.cloneNode(true);
    const originals = [svg, ...svg.querySelectorAll("*")];
    [copy, ...copy.querySelectorAll("*")].forEach((element, i) => {
      const style = getComputedStyle(originals[i]);
      element.setAttribute("style", KEPT.map((name) => `${name}:${style.getPropertyValue(name)}`).join(";"));
    });
    copy.querySelectorAll(".cursor,.dot").forEach((element) => element.remove());
    copy.setAttribute("xmlns", SVG);
    return copy;
  }

  /** The drawings of a figure as one file, under each other. */
  function save(drawings) {
    let file = plain(drawings[0]);
    if (drawings.length > 1) {
      file = document.createElementNS(SVG, "svg");
      let bottom = 0;
      for (const drawing of drawings) {
        const { width, height } = drawing.viewBox.baseVal;
        const part = plain(drawing);
        for (const [name, value] of Object.entries({ x: 0, y: bottom, width, height })) part.setAttribute(name, value);
        file.append(part);
        bottom += height;
      }
      const widest = Math.max(...drawings.map((one) => one.viewBox.baseVal.width));
      file.setAttribute("viewBox", `0 0 ${widest} ${bottom}`);
    }
    const label = drawings.map((one) => one.getAttribute("aria-label")).find(Boolean);
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([new XMLSerializer().serializeToString(file)], { type: "image/svg+xml" }));
    link.download = `${(label || "figure").replace(/[^\w]+/g, "-").toLowerCase()}.svg`;
    link.click();
    URL.revokeObjectURL(link.href);
  }

  for (const figure of document.querySelectorAll(".figures figure")) {
    const button = Object.assign(document.createElement("button"), { className: "save", type: "button", textContent: "Save SVG" });
    button.addEventListener("click", () => save([...figure.querySelectorAll("svg")]));
    figure.append(button);
  }

  /* The moving skeleton */

  const source = document.getElementById("motion");
  if (source) play(JSON.parse(source.textContent), document.querySelector(".player"));

  function play(data, box) {
    box.hidden = false;
    const canvas = box.querySelector("canvas");
    const context = canvas.getContext("2d");
    const scrub = box.querySelector(".scrub");
    const clock = box.querySelector(".clock");
    const button = box.querySelector(".play");
    const speed = box.querySelector(".speed");
    const time = data.time;
    const last = time.length - 1;
    const poses = new Float32Array(bytes(data.poses).buffer);
    const points = new Int16Array(bytes(data.points).buffer);
    const activation = bytes(data.activation);
    const ramp = bytes(data.colors);
    const pointCount = data.counts.reduce((sum, count) => sum + count, 0);
    const solids = data.solids.map((solid, i) => {
      const packed = new Int16Array(bytes(solid.vertices).buffer);
      const vertices = Float32Array.from(packed, (value, k) => solid.low[k % 3] + value * solid.step);
      const faces = solid.wide ? new Uint32Array(bytes(solid.faces).buffer) : new Uint16Array(bytes(solid.faces).buffer);
      return { body: data.bodies[i], vertices, faces, sign: orientation(vertices, faces), placed: new Float32Array(vertices.length) };
    });
    const triangles = solids.reduce((sum, solid) => sum + solid.faces.length / 3, 0);
    const capacity = triangles + pointCount;
    const depth = new Float32Array(capacity);
    const items = Array.from({ length: capacity }, () => null);
    const tones = Array.from({ length: 48 }, (_, i) => {
      const light = 0.42 + (0.62 * i) / 47;
      return `rgb(${(240 * light) | 0},${(229 * light) | 0},${(206 * light) | 0})`;
    });
    const colors = Array.from({ length: 255 }, (_, i) => {
      const k = 3 * Math.round((i / 254) * 255);
      return `rgb(${ramp[k]},${ramp[k + 1]},${ramp[k + 2]})`;
    });
    const state = { yaw: 0.45, pitch: 0.12, zoom: 1, time: time[0], playing: false };

    /** 1 where faces turn counter-clockwise outwards, -1 where clockwise: the sign of the volume. */
    function orientation(vertices, faces) {
      let volume = 0;
      for (let f = 0; f < faces.length; f += 3) {
        const [a, b, c] = [3 * faces[f], 3 * faces[f + 1], 3 * faces[f + 2]];
        volume +=
          vertices[a] * (vertices[b + 1] * vertices[c + 2] - vertices[b + 2] * vertices[c + 1]) -
          vertices[a + 1] * (vertices[b] * vertices[c + 2] - vertices[b + 2] * vertices[c]) +
          vertices[a + 2] * (vertices[b] * vertices[c + 1] - vertices[b + 1] * vertices[c]);
      }
      return volume < 0 ? -1 : 1;
    }

    const mix = (a, b, u, v) => a.map((one, i) => u * one + v * b[i]);
    const dot = (a, x, y, z) => a[0] * x + a[1] * y + a[2] * z;

    /** Right, up and towards the viewer, from the angles. */
    function axes() {
      const across = mix(data.forward, data.right, Math.cos(state.yaw), -Math.sin(state.yaw));
      const level = mix(data.right, data.forward, Math.cos(state.yaw), Math.sin(state.yaw));
      return [across, mix(data.up, level, Math.cos(state.pitch), -Math.sin(state.pitch)), mix(level, data.up, Math.cos(state.pitch), Math.sin(state.pitch))];
    }

    /** Frame before the time, and the share of the next one. */
    function frameAt(t) {
      let low = 0;
      while (low < last - 1 && time[low + 1] <= t) low++;
      const share = last > 0 ? (t - time[low]) / (time[low + 1] - time[low]) : 0;
      return [low, Math.min(Math.max(share, 0), 1)];
    }

    function draw() {
      const ratio = Math.min(devicePixelRatio || 1, 2);
      const width = canvas.clientWidth || 900;
      const height = Math.round(Math.min(620, Math.max(340, width * 0.54)));
      if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
        canvas.width = Math.round(width * ratio);
        canvas.height = Math.round(height * ratio);
        canvas.style.height = `${height}px`;
      }
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
      context.clearRect(0, 0, width, height);
      const [X, Y, Z] = axes();
      const [frame, share] = frameAt(state.time);
      const next = Math.min(frame + 1, last);
      const tall = Math.max(data.high - data.low, 0.4 * data.size);
      const scale = Math.min((height * 0.88) / tall, (width * 0.8) / data.size) * state.zoom;
      const pose = new Float32Array(12 * data.poseCount);
      const center = [0, 0, 0];
      for (let i = 0; i < pose.length; i++) {
        pose[i] = (1 - share) * poses[frame * pose.length + i] + share * poses[next * pose.length + i];
        if (i % 12 > 8) center[(i % 12) - 9] += pose[i] / data.poseCount;
      }
      // The floor stays where it is in the picture; only the way along it is followed.
      const lift = (data.low + data.high) / 2 - dot(data.up, ...center);
      for (let i = 0; i < 3; i++) center[i] += lift * data.up[i];
      const shift = [width / 2, height / 2];
      const toX = (x, y, z) => shift[0] + scale * dot(X, x - center[0], y - center[1], z - center[2]);
      const toY = (x, y, z) => shift[1] - scale * dot(Y, x - center[0], y - center[1], z - center[2]);
      floor(center, toX, toY);
      let count = 0;
      for (const solid of solids) {
        const at = 12 * solid.body;
        const { vertices, placed, faces } = solid;
        for (let k = 0; k < vertices.length; k += 3) {
          const [u, v, w] = [vertices[k], vertices[k + 1], vertices[k + 2]];
          const x = pose[at] * u + pose[at + 1] * v + pose[at + 2] * w + pose[at + 9] - center[0];
          const y = pose[at + 3] * u + pose[at + 4] * v + pose[at + 5] * w + pose[at + 10] - center[1];
          const z = pose[at + 6] * u + pose[at + 7] * v + pose[at + 8] * w + pose[at + 11] - center[2];
          placed[k] = shift[0] + scale * dot(X, x, y, z);
          placed[k + 1] = shift[1] - scale * dot(Y, x, y, z);
          placed[k + 2] = scale * dot(Z, x, y, z);
        }
        for (let f = 0; f < faces.length; f += 3) {
          const [a, b, c] = [3 * faces[f], 3 * faces[f + 1], 3 * faces[f + 2]];
          const [ux, uy, uz] = [placed[b] - placed[a], placed[a + 1] - placed[b + 1], placed[b + 2] - placed[a + 2]];
          const [vx, vy, vz] = [placed[c] - placed[a], placed[a + 1] - placed[c + 1], placed[c + 2] - placed[a + 2]];
          const nz = (ux * vy - uy * vx) * solid.sign;
          if (nz <= 0) continue;
          const nx = (uy * vz - uz * vy) * solid.sign;
          const ny = (uz * vx - ux * vz) * solid.sign;
          const size = Math.hypot(nx, ny, nz) || 1;
          const light = Math.max(0, (-0.35 * nx + 0.55 * ny + 0.76 * nz) / size) * 0.8 + (0.2 * nz) / size;
          depth[count] = (placed[a + 2] + placed[b + 2] + placed[c + 2]) / 3;
          items[count++] = [placed, a, b, c, tones[Math.min(47, (light * 47) | 0)]];
        }
      }
      count = muscles(frame, next, share, count, toX, toY, center, Z, scale);
      const order = Uint32Array.from({ length: count }, (_, i) => i).sort((a, b) => depth[a] - depth[b]);
      context.lineJoin = context.lineCap = "round";
      for (const i of order) {
        const item = items[i];
        context.beginPath();
        if (item.length === 5) {
          const [placed, a, b, c, tone] = item;
          context.moveTo(placed[a], placed[a + 1]);
          context.lineTo(placed[b], placed[b + 1]);
          context.lineTo(placed[c], placed[c + 1]);
          context.closePath();
          context.fillStyle = context.strokeStyle = tone;
          context.lineWidth = 0.7;
          context.fill();
          context.stroke();
        } else {
          context.moveTo(item[0], item[1]);
          context.lineTo(item[2], item[3]);
          context.strokeStyle = item[4];
          context.lineWidth = item[5];
          context.stroke();
        }
      }
      forces(frame, next, share, toX, toY);
      clock.textContent = `${state.time.toFixed(3)} s`;
      scrub.value = (state.time - time[0]) / (time[last] - time[0] || 1);
    }

    /** Lines on the floor, a few per body length. */
    function floor(center, toX, toY) {
      const cell = 10 ** Math.round(Math.log10(data.size / 4));
      const [a, b] = [dot(data.forward, ...center), dot(data.right, ...center)];
      const place = (u, v) => [0, 1, 2].map((i) => u * data.forward[i] + v * data.right[i] + data.floor * data.up[i]);
      context.strokeStyle = getComputedStyle(document.body).getPropertyValue("--rule");
      context.lineWidth = 1;
      context.beginPath();
      const line = (from, to) => {
        context.moveTo(toX(...from), toY(...from));
        context.lineTo(toX(...to), toY(...to));
      };
      const reach = Math.ceil((1.1 * data.size) / cell);
      for (let i = -reach; i <= reach; i++) {
        const [u, v] = [(Math.round(a / cell) + i) * cell, (Math.round(b / cell) + i) * cell];
        line(place(u, b - reach * cell), place(u, b + reach * cell));
        line(place(a - reach * cell, v), place(a + reach * cell, v));
      }
      context.stroke();
    }

    function muscles(frame, next, share, count, toX, toY, center, Z, scale) {
      let first = 0;
      const row = 3 * pointCount;
      data.counts.forEach((many, muscle) => {
        const level = activation[frame * data.counts.length + muscle];
        const color = level === 255 ? data.plain : colors[level];
        const thick = Math.max(1, 2 * data.radii[muscle] * scale);
        let before = null;
        for (let k = first; k < first + many; k++) {
          const [i, j] = [frame * row + 3 * k, next * row + 3 * k];
          if (points[i] === -32768) continue;
          const steady = points[j] === -32768 ? 0 : share;
          const at = [0, 1, 2].map((d) => data.middle[d] + data.step * ((1 - steady) * points[i + d] + steady * points[j + d]));
          const here = [toX(...at), toY(...at), scale * dot(Z, at[0] - center[0], at[1] - center[1], at[2] - center[2])];
          if (before) {
            depth[count] = (before[2] + here[2]) / 2 + thick;
            items[count++] = [before[0], before[1], here[0], here[1], color, thick];
          }
          before = here;
        }
        first += many;
      });
      return count;
    }

    function forces(frame, next, share, toX, toY) {
      const [here, after] = [data.forces[frame], data.forces[next]];
      for (let k = 0; k < here.length; k += 6) {
        const value = here.slice(k, k + 6).map((one, i) => (1 - share) * one + share * after[k + i]);
        const from = here[k + 3] || here[k + 4] || here[k + 5] ? here.slice(k, k + 3) : after.slice(k, k + 3);
        const size = Math.hypot(value[3], value[4], value[5]);
        if (size < 0.02) continue;
        const start = size > 0.1 && after[k + 4] !== 0 && here[k + 4] !== 0 ? value.slice(0, 3) : from;
        const tip = start.map((one, i) => one + 0.35 * data.size * value[3 + i]);
        const [x0, y0, x1, y1] = [toX(...start), toY(...start), toX(...tip), toY(...tip)];
        const long = Math.hypot(x1 - x0, y1 - y0) || 1;
        const [u, v] = [(x1 - x0) / long, (y1 - y0) / long];
        context.strokeStyle = context.fillStyle = "#1f9c78";
        context.lineWidth = 3;
        context.beginPath();
        context.moveTo(x0, y0);
        context.lineTo(x1 - 8 * u, y1 - 8 * v);
        context.stroke();
        context.beginPath();
        context.moveTo(x1, y1);
        context.lineTo(x1 - 11 * u + 5 * v, y1 - 11 * v - 5 * u);
        context.lineTo(x1 - 11 * u - 5 * v, y1 - 11 * v + 5 * u);
        context.fill();
      }
    }

    let planned = false;
    function redraw() {
      if (planned) return;
      planned = true;
      requestAnimationFrame(() => {
        planned = false;
        draw();
      });
    }

    // A folded body has no size to be drawn in.
    box.closest("details")?.addEventListener("toggle", redraw);

    let before = 0;
    function step(stamp) {
      if (!state.playing) return;
      state.time += ((stamp - before) / 1000) * Number(speed.value);
      before = stamp;
      if (state.time > time[last]) state.time = time[0];
      draw();
      setTime(state.time, canvas);
      requestAnimationFrame(step);
    }

    button.addEventListener("click", () => {
      state.playing = !state.playing;
      button.textContent = state.playing ? "❚❚" : "▶";
      if (state.playing) {
        requestAnimationFrame((stamp) => {
          before = stamp;
          step(stamp);
        });
      }
    });
    scrub.addEventListener("input", () => {
      state.time = time[0] + Number(scrub.value) * (time[last] - time[0]);
      setTime(state.time, canvas);
      redraw();
    });
    for (const one of box.querySelectorAll(".view")) {
      one.addEventListener("click", () => {
        Object.assign(state, one.dataset.view === "side" ? { yaw: 0, pitch: 0 } : { yaw: Math.PI / 2, pitch: 0 });
        redraw();
      });
    }
    let grip = null;
    canvas.addEventListener("pointerdown", (event) => {
      grip = [event.clientX, event.clientY, state.yaw, state.pitch];
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!grip) return;
      state.yaw = grip[2] - (event.clientX - grip[0]) * 0.009;
      state.pitch = Math.min(1.5, Math.max(-0.6, grip[3] + (event.clientY - grip[1]) * 0.007));
      redraw();
    });
    canvas.addEventListener("pointerup", () => {
      grip = null;
    });
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        state.zoom = Math.min(8, Math.max(0.5, state.zoom * Math.exp(-event.deltaY * 0.0012)));
        redraw();
      },
      { passive: false },
    );
    listeners.push((t, from) => {
      if (from === canvas || state.playing || !(t >= time[0] && t <= time[last])) return;
      state.time = t;
      redraw();
    });
    addEventListener("resize", redraw);
    draw();
  }
})();
