// Draws the recovered body so that it can be turned. Nearer triangles are painted over farther ones.
"use strict";
(() => {
  const body = JSON.parse(document.getElementById("body-data").textContent);
  const canvas = document.getElementById("body-canvas");
  const chosen = document.getElementById("body-chosen");
  const context = canvas.getContext("2d");
  const labels = new Set(body.labels);
  const route = [];
  let azimuth = -1.01, elevation = 0.49, marks = [];

  const minus = (a, b) => a.map((x, i) => x - b[i]);
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [
    a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => { const n = Math.hypot(...a) || 1; return a.map((x) => x / n); };

  const triangles = [], dots = [];
  for (const part of body.parts) {
    const normals = part.places.map(() => [0, 0, 0]);
    for (const face of part.faces) {
      const [a, b, c] = face.map((k) => part.places[k]);
      const normal = cross(minus(b, a), minus(c, a));
      face.forEach((k) => { normals[k] = normals[k].map((x, i) => x + normal[i]); });
      triangles.push({ corners: [a, b, c], normal: unit(normal), closed: part.closed });
    }
    part.kernels.forEach((kernel, k) => {
      dots.push({ kernel, place: part.places[k], normal: unit(normals[k]), closed: part.closed });
    });
  }

  function draw() {
    const side = canvas.clientWidth, ratio = window.devicePixelRatio || 1;
    canvas.width = canvas.height = Math.round(side * ratio);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    const ink = getComputedStyle(canvas).color;
    const [ca, sa, ce, se] = [
      Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
    const right = [-sa, ca, 0], towards = [ce * ca, ce * sa, se], up = cross(towards, right);
    const light = unit([0, 1, 2].map((i) => -0.55 * right[i] + 0.75 * up[i] + towards[i]));
    const scale = side / 3.4;
    const seen = (p) => [side / 2 + scale * dot(p, right), side / 2 - scale * dot(p, up)];
    const things = [];
    for (const t of triangles) {
      const facing = dot(t.normal, towards);
      if (t.closed && facing < 0) continue;
      const normal = facing < 0 ? t.normal.map((x) => -x) : t.normal;
      const bright = 0.5 + 0.54 * Math.max(0, dot(normal, light));
      const depth = dot(t.corners[0], towards) + dot(t.corners[1], towards) + dot(t.corners[2], towards);
      things.push({ t, bright, depth: depth / 3 });
    }
    for (const d of dots) {
      if (d.closed && dot(d.normal, towards) < 0) continue;
      things.push({ d, depth: dot(d.place, towards) + 0.03 });
    }
    things.sort((a, b) => a.depth - b.depth);
    marks = [];
    for (const thing of things) {
      context.beginPath();
      if (thing.t) {
        thing.t.corners.forEach((p, i) => context[i ? "lineTo" : "moveTo"](...seen(p)));
        context.closePath();
        const color = [93, 184, 156].map((x) => Math.min(255, Math.round(x * thing.bright)));
        context.fillStyle = context.strokeStyle = `rgb(${color})`;
        context.fill();
        context.stroke();
        continue;
      }
      const [x, y] = seen(thing.d.place), end = route.indexOf(thing.d.kernel);
      context.arc(x, y, end >= 0 ? 7 : 2, 0, 7);
      context.fillStyle = end === 0 ? "#009E73" : end > 0 ? "#0072B2" : "#22262b";
      context.fill();
      marks.push({ x, y, kernel: thing.d.kernel });
    }
    // Numbers last, so that no triangle covers them; only those whose place faces the reader.
    context.font = "600 12px system-ui, sans-serif";
    context.textAlign = "center";
    context.lineWidth = 3;
    for (const d of dots) {
      const named = labels.has(d.kernel) || route.includes(d.kernel);
      if (!named || dot(d.normal, towards) < 0.25) continue;
      const [x, y] = seen(d.place);
      context.strokeStyle = "#ffffffd0";
      context.strokeText(d.kernel, x, y - 6);
      context.fillStyle = "#22262b";
      context.fillText(d.kernel, x, y - 6);
    }
    context.lineWidth = 1;
    canvas.style.borderColor = ink;
  }

  function turn(right, up) {
    azimuth -= right;
    elevation = Math.max(-1.5, Math.min(1.5, elevation + up));
    draw();
  }

  function choose(x, y) {
    let nearest = null;
    for (const mark of marks) {
      const apart = Math.hypot(mark.x - x, mark.y - y);
      // Marks are in the order in which they were drawn: of two as near, the front one counts.
      if (apart < 40 && (!nearest || apart <= nearest.apart)) nearest = { ...mark, apart };
    }
    if (!nearest) return;
    if (route.length === 2) route.length = 0;
    route.push(nearest.kernel);
    chosen.textContent = route.length === 1
      ? `sensation ${route[0]}: now choose a goal`
      : `--from ${route[0]} --to ${route[1]}`;
    draw();
  }

  let from = null, moved = 0;
  canvas.addEventListener("pointerdown", (event) => {
    from = [event.clientX, event.clientY];
    moved = 0;
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!from) return;
    const [dx, dy] = [event.clientX - from[0], event.clientY - from[1]];
    moved += Math.abs(dx) + Math.abs(dy);
    from = [event.clientX, event.clientY];
    turn(0.01 * dx, 0.01 * dy);
  });
  canvas.addEventListener("pointerup", (event) => {
    if (from && moved < 5) choose(event.offsetX, event.offsetY);
    from = null;
  });
  canvas.addEventListener("pointercancel", () => { from = null; });
  canvas.addEventListener("keydown", (event) => {
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    if (!way[event.key]) return;
    event.preventDefault();
    turn(0.15 * way[event.key][0], 0.15 * way[event.key][1]);
  });
  window.addEventListener("resize", draw);
  draw();
})();
