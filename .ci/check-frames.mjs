// Does three.js show, at each time of an animated GLB, the surface that the file of that frame holds?
// Usage: node check-frames.mjs ANIMATION.glb TIMES.pvd FRAME_0.glb FRAME_1.glb ...
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { pathToFileURL } from "node:url";

// Pictures are not in our files, but the loader looks for this name.
globalThis.self = globalThis;
const part = (path) => import(pathToFileURL(join(process.cwd(), "node_modules/three", path)));
const THREE = await part("build/three.module.js");
const { GLTFLoader } = await part("examples/jsm/loaders/GLTFLoader.js");

const load = (path) => {
  const bytes = readFileSync(path);
  const buffer = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
  return new Promise((resolve, reject) => new GLTFLoader().parse(buffer, "", resolve, reject));
};

// Vertices of what is in sight by the organ's name, in world metres, morph targets applied as the shader does.
const seen = (scene) => {
  scene.updateMatrixWorld(true);
  const organs = new Map();
  scene.traverse((mesh) => {
    if (!mesh.isMesh || Math.abs(mesh.matrixWorld.determinant()) < 1e-30) return;
    const place = new THREE.Vector3();
    const places = [];
    for (let n = 0; n < mesh.geometry.attributes.position.count; n += 1) {
      mesh.getVertexPosition(n, place).applyMatrix4(mesh.matrixWorld);
      places.push(place.x, place.y, place.z);
    }
    const name = mesh.material.name;
    if (organs.has(name)) throw new Error(`${name} is in sight twice`);
    organs.set(name, places);
  });
  return organs;
};

const [animated, list, ...frames] = process.argv.slice(2);
const times = [...readFileSync(list, "utf8").matchAll(/timestep="([^"]+)"/g)].map((match) => Number(match[1]));
if (times.length !== frames.length) throw new Error(`${times.length} times for ${frames.length} frames`);
const { scene, animations } = await load(animated);
const mixer = new THREE.AnimationMixer(scene);
mixer.clipAction(animations[0]).play();
let worst = 0;
for (const [n, path] of frames.entries()) {
  // A frame lasts until the next; in single precision its key may lie a little after its time.
  mixer.setTime(times[n] + 1e-6);
  const [found, expected] = [seen(scene), seen((await load(path)).scene)];
  if ([...found.keys()].sort().join() !== [...expected.keys()].sort().join()) {
    throw new Error(`frame ${n}: ${[...found.keys()]} in sight, expected ${[...expected.keys()]}`);
  }
  for (const [name, places] of expected) {
    const moved = found.get(name);
    if (moved.length !== places.length) throw new Error(`frame ${n}, ${name}: ${moved.length} numbers, not ${places.length}`);
    places.forEach((x, at) => (worst = Math.max(worst, Math.abs(x - moved[at]))));
  }
}
// Interpolation over a microsecond, single precision and quantisation.
const ok = worst < 1e-5;
console.log(`${animated}: ${frames.length} frames in three.js, at most ${(worst * 1e3).toExponential(1)} mm off: ${ok ? "ok" : "FAILED"}`);
process.exit(ok ? 0 : 1);
