"use strict";
// Lobes in space, turned by hand: a mesh of f over the outgoing hemisphere, painted from the far side to the near one.
(() => {
  const VIRIDIS = [[68,1,84],[72,26,108],[71,47,125],[65,68,135],[57,86,140],[49,104,142],[42,120,142],[35,136,142],
    [31,152,139],[34,168,132],[53,183,121],[84,197,104],[122,209,81],[165,219,54],[210,226,27],[253,231,37]];
  const START = {turn: 35, tilt: 22, size: 1}, DECADES = 5, RAD = Math.PI / 180;
  const held = JSON.parse(document.getElementById("gonio-lobes").textContent);

  const colour = level => {
    const x = Math.min(Math.max(level, 0), 1) * (VIRIDIS.length - 1), k = Math.min(Math.floor(x), VIRIDIS.length - 2);
    const mixed = VIRIDIS[k].map((a, j) => Math.round(a + (x - k) * (VIRIDIS[k + 1][j] - a)));
    return `rgb(${mixed.join()})`;
  };
  const decoded = text => {
    const bytes = atob(text), out = new Float64Array(bytes.length / 2);
    for (let k = 0; k < out.length; k++) out[k] = (bytes.charCodeAt(2 * k) + 256 * bytes.charCodeAt(2 * k + 1)) / 65534;
    return out.map(v => v > 1 ? NaN : v);
  };

  const stage = (figure, data) => {
    const canvas = figure.querySelector("canvas"), pen = canvas.getContext("2d");
    const [source, incidence] = figure.querySelectorAll("select"), log = figure.querySelector("input");
    const through = data.sources.some(s => s.sets.some(set => set.t[set.t.length - 1] > 90));
    const [centre, height, lowest] = through ? [0.5, 2.15, -90] : [0.69, 1.55, 0];
    let eye = {...START}, mesh = null;

    const option = (list, texts) => texts.forEach((text, k) => list.add(new Option(text, k)));
    option(source, data.sources.map(s => s.name));
    option(incidence, data.sources[0].sets.map(s => `${+s.i.toPrecision(4)}°`));
    incidence.value = Math.floor(data.sources[0].sets.length / 2);
    log.checked = data.log;
    source.parentElement.hidden = data.sources.length < 2;

    const build = () => {
      const set = data.sources[source.value].sets[incidence.value], level = decoded(set.f), columns = set.p.length;
      let top = 0;
      for (const v of level) if (v > top) top = v;
      const radius = v => v <= 0 ? 0 : log.checked
        ? Math.max(0, 1 + (v - top) * data.decades / DECADES) : 10 ** ((v - top) * data.decades);
      const points = [];
      for (let i = 0; i < set.t.length; i++) for (let j = 0; j < columns; j++) {
        const r = radius(level[i * columns + j]), t = set.t[i] * RAD, p = set.p[j] * RAD;
        points.push([-r * Math.sin(t) * Math.cos(p), -r * Math.sin(t) * Math.sin(p), r * Math.cos(t), r]);
      }
      const faces = [];
      for (let i = 0; i + 1 < set.t.length; i++) for (let j = 0; j + 1 < columns; j++) {
        const k = i * columns + j, corners = [k, k + columns, k + columns + 1, k + 1];
        if (corners.some(c => isNaN(points[c][3]))) continue;  // nothing was read there
        faces.push([corners, colour((points[k][3] + points[k + columns + 1][3]) / 2)]);
      }
      mesh = {points, faces, theta: set.i * RAD};
    };

    const draw = () => {
      const box = canvas.getBoundingClientRect(), ratio = window.devicePixelRatio || 1;
      if (!box.width) return;
      canvas.width = Math.round(box.width * ratio);
      canvas.height = Math.round(box.height * ratio);
      const style = getComputedStyle(canvas), ink = style.color, faint = style.getPropertyValue("--faint");
      const scale = eye.size * Math.min(canvas.width / 2.3, canvas.height / height);
      const a = eye.turn * RAD, b = eye.tilt * RAD, ca = Math.cos(a), sa = Math.sin(a), cb = Math.cos(b), sb = Math.sin(b);
      const put = (x, y, z) => {
        const away = y * ca - x * sa;
        return [canvas.width / 2 + scale * (x * ca + y * sa), canvas.height * centre - scale * (z * cb + away * sb), z * sb - away * cb];
      };
      const line = (from, to, width, dash) => {
        pen.setLineDash(dash || []);
        pen.lineWidth = width * ratio;
        pen.beginPath();
        pen.moveTo(from[0], from[1]);
        pen.lineTo(to[0], to[1]);
        pen.stroke();
      };
      pen.clearRect(0, 0, canvas.width, canvas.height);
      pen.strokeStyle = faint;
      pen.lineWidth = ratio;
      pen.setLineDash([]);
      pen.beginPath();
      for (let k = 0; k <= 90; k++) pen.lineTo(...put(Math.cos(4 * k * RAD), Math.sin(4 * k * RAD), 0).slice(0, 2));
      pen.stroke();
      line(put(-1, 0, 0), put(1, 0, 0), 0.8, [4 * ratio, 3 * ratio]);
      const at = mesh.points.map(p => put(p[0], p[1], p[2]));
      const depth = f => f[0].reduce((sum, k) => sum + at[k][2], 0);
      const order = mesh.faces.map((f, k) => [depth(f), k]).sort((p, q) => p[0] - q[0]);
      pen.lineWidth = 1.2 * ratio;
      for (const [, k] of order) {
        const [corners, tint] = mesh.faces[k];
        pen.fillStyle = pen.strokeStyle = tint;
        pen.beginPath();
        for (const c of corners) pen.lineTo(at[c][0], at[c][1]);
        pen.closePath();
        pen.fill();
        pen.stroke();
      }
      pen.strokeStyle = pen.fillStyle = ink;
      const s = Math.sin(mesh.theta), c = Math.cos(mesh.theta), tail = put(-s, 0, c), tip = put(-0.75 * s, 0, 0.75 * c);
      line(tail, tip, 1.3);
      const along = Math.atan2(tip[1] - tail[1], tip[0] - tail[0]);
      pen.beginPath();
      for (const turn of [0, 2.75, -2.75]) {
        const far = turn ? 9 * ratio : 0;
        pen.lineTo(tip[0] + far * Math.cos(along + turn), tip[1] + far * Math.sin(along + turn));
      }
      pen.fill();
      pen.font = `${11 * ratio}px sans-serif`;
      pen.textAlign = "center";
      pen.fillText("light", tail[0], tail[1] - 5 * ratio);
    };

    let waiting = false;
    const soon = () => {
      if (waiting) return;
      waiting = true;
      requestAnimationFrame(() => { waiting = false; if (!mesh) build(); draw(); });
    };
    const turned = (turn, tilt, size = 1) => {
      eye = {turn: eye.turn + turn, tilt: Math.min(90, Math.max(lowest, eye.tilt + tilt)), size: Math.min(4, Math.max(0.5, eye.size * size))};
      soon();
    };
    const again = () => { eye = {...START}; soon(); };
    const KEYS = {ArrowLeft: [-6, 0], ArrowRight: [6, 0], ArrowUp: [0, 6], ArrowDown: [0, -6], "+": [0, 0, 1.15], "=": [0, 0, 1.15], "-": [0, 0, 1 / 1.15]};
    canvas.addEventListener("keydown", event => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (event.key === "Home") again();
      else if (KEYS[event.key]) turned(...KEYS[event.key]);
      else return;
      event.preventDefault();
    });
    let last = null;
    canvas.addEventListener("pointerdown", event => { last = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId); });
    canvas.addEventListener("pointermove", event => {
      if (!last) return;
      turned((last[0] - event.clientX) * 0.5, (event.clientY - last[1]) * 0.4);
      last = [event.clientX, event.clientY];
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) canvas.addEventListener(end, () => { last = null; });
    const buttons = figure.querySelectorAll("button"), moves = [[-15, 0], [15, 0], [0, 10], [0, -10], null];
    buttons.forEach((button, k) => button.addEventListener("click", () => moves[k] ? turned(...moves[k]) : again()));
    for (const control of [source, incidence, log]) control.addEventListener("change", () => { build(); soon(); });
    figure.classList.add("live");
    new IntersectionObserver(entries => { if (entries.some(e => e.isIntersecting)) soon(); }).observe(canvas);
    new ResizeObserver(soon).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", soon);
  };

  for (const figure of document.querySelectorAll("figure[data-lobe]")) stage(figure, held[figure.dataset.lobe]);
  addEventListener("beforeprint", () => document.querySelectorAll("details").forEach(d => { d.open = true; }));
})();
