"use strict";
// A robot in three.js: links with their shapes, moved by joints.
const Robot = (() => {
  const quaternion = (q) => new THREE.Quaternion(q[0], q[1], q[2], q[3]);
  const vector = (v) => new THREE.Vector3(v[0], v[1], v[2]);

  // three.js lays cylinders along y, the model along z.
  function alongZ(geometry) {
    return geometry.rotateX(Math.PI / 2);
  }

  const GEOMETRIES = {
    sphere: ([radius]) => [new THREE.SphereGeometry(radius, 24, 16)],
    box: (edges) => [new THREE.BoxGeometry(...edges)],
    cylinder: ([length, radius]) => [alongZ(new THREE.CylinderGeometry(radius, radius, length, 24))],
    capsule: ([length, radius]) => [
      alongZ(new THREE.CylinderGeometry(radius, radius, length, 24, 1, true)),
      new THREE.SphereGeometry(radius, 24, 12).translate(0, 0, length / 2),
      new THREE.SphereGeometry(radius, 24, 12).translate(0, 0, -length / 2),
    ],
  };

  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;

  // Meshes come as triangles; the order of their corners cannot be relied on, so both sides are drawn.
  function triangles({ size, vertices, triangles }) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(bytes(vertices)), 3));
    geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(bytes(triangles)), 1));
    return [geometry.scale(...size)];
  }

  function addShape(group, shape) {
    const { kind, size, pose, color } = shape;
    const [red, green, blue, opacity] = color;
    const mesh = kind === "mesh";
    const material = new THREE.MeshStandardMaterial({ color: new THREE.Color(red, green, blue), roughness: 0.65, transparent: opacity < 1, opacity, flatShading: mesh, side: mesh ? THREE.DoubleSide : THREE.FrontSide });
    for (const geometry of mesh ? triangles(shape) : GEOMETRIES[kind](size)) {
      const part = new THREE.Mesh(geometry, material);
      part.position.copy(vector(pose));
      part.quaternion.copy(quaternion(pose.slice(3)));
      part.castShadow = true;
      group.add(part);
    }
  }

  // Builds a robot; `lost` names the links that damage has taken.
  function build(model, lost) {
    const links = new Map();
    for (const link of model.links) {
      const group = new THREE.Group();
      for (const shape of lost.includes(link.name) ? [] : link.shapes) addShape(group, shape);
      links.set(link.name, group);
    }
    const movable = [];
    for (const joint of model.joints) {
      const child = links.get(joint.child);
      child.position.copy(vector(joint.origin));
      child.quaternion.copy(quaternion(joint.origin.slice(3)));
      links.get(joint.parent).add(child);
      if (joint.kind !== "fixed") {
        movable.push({ child, slides: joint.kind === "prismatic", axis: vector(joint.axis), position: child.position.clone(), rotation: child.quaternion.clone() });
      }
    }
    const group = links.get(model.links[0].name);
    const turned = new THREE.Quaternion();

    // Poses the robot: position and quaternion of its base, then its joints.
    function set(pose) {
      group.position.set(pose[0], pose[1], pose[2]);
      group.quaternion.set(pose[3], pose[4], pose[5], pose[6]);
      movable.forEach(({ child, slides, axis, position, rotation }, i) => {
        const q = pose[7 + i];
        if (slides) child.position.copy(axis).multiplyScalar(q).applyQuaternion(rotation).add(position);
        else child.quaternion.copy(rotation).multiply(turned.setFromAxisAngle(axis, q));
      });
    }

    // The joints as they are drawn now.
    function joints() {
      return movable.map(({ child, slides, axis, position, rotation }) => {
        const back = rotation.clone().invert();
        if (slides) return child.position.clone().sub(position).applyQuaternion(back).dot(axis);
        const turn = back.multiply(child.quaternion);
        return 2 * Math.atan2(turn.x * axis.x + turn.y * axis.y + turn.z * axis.z, turn.w);
      });
    }

    function drop() {
      group.traverse((part) => {
        if (part.geometry) part.geometry.dispose();
        if (part.material) part.material.dispose();
      });
    }

    return { group, set, joints, drop };
  }

  return { build };
})();
