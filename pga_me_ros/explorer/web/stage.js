"use strict";
// The ground, the light and the camera, and as many robots as are watched, each in its lane.
const Stage = (() => {
  const LANE = 1.6; // meters between two robots
  const HALF = 30; // half the side of the ground, meters
  const MIDDLE = 0.55; // height that the camera looks at, meters
  const UP = new THREE.Vector3(0, 0, 1);
  // What keys do to the camera: turn it, tilt it (radians), go closer or farther.
  const KEYS = { ArrowLeft: [-0.15, 0, 1], ArrowRight: [0.15, 0, 1], ArrowUp: [0, -0.1, 1], ArrowDown: [0, 0.1, 1], "+": [0, 0, 1 / 1.15], "-": [0, 0, 1.15] };
  let renderer = null;
  let scene;
  let camera;
  let controls;
  let ground;
  let sun;
  let lanes = [];
  let seen = 1; // robots that the camera was placed for
  let waiting = false;

  // Starts WebGL; returns why it cannot, or an empty text.
  function open(place) {
    try {
      renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
    } catch (error) {
      return `This browser cannot draw 3-D (WebGL): ${error.message}`;
    }
    scene = new THREE.Scene();
    THREE.Object3D.DefaultUp.set(0, 0, 1);
    camera = new THREE.PerspectiveCamera(38, 1, 0.05, 200);
    camera.up.set(0, 0, 1);
    renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    renderer.shadowMap.enabled = true;
    place.append(renderer.domElement);
    controls = new THREE.OrbitControls(camera, renderer.domElement);
    controls.enablePan = false;
    controls.minDistance = 0.8;
    controls.maxDistance = 30;
    controls.maxPolarAngle = 1.55;
    controls.addEventListener("change", render);
    controls.target.z = MIDDLE;
    lookAt(1);
    place.addEventListener("keydown", turn);
    scene.add(new THREE.HemisphereLight(0xffffff, 0x8892a0, 0.6));
    sun = new THREE.DirectionalLight(0xffffff, 0.5);
    sun.castShadow = true;
    sun.shadow.mapSize.set(1024, 1024);
    Object.assign(sun.shadow.camera, { left: -5, right: 5, top: 5, bottom: -5, far: 20 });
    scene.add(sun, sun.target);
    new ResizeObserver(() => resize(place)).observe(place);
    theme();
    resize(place);
    return "";
  }

  // A plane with a line per meter. It goes along in whole meters, so that it seems endless and the grid stays in place.
  function theme() {
    if (!renderer) return;
    const back = new THREE.Color(Page.color("back"));
    scene.background = back;
    scene.fog = new THREE.Fog(back, 9, 24);
    if (ground) scene.remove(ground);
    const plane = new THREE.Mesh(new THREE.PlaneGeometry(2 * HALF, 2 * HALF), new THREE.MeshLambertMaterial({ color: Page.color("ground"), polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 }));
    plane.receiveShadow = true;
    ground = new THREE.Group();
    ground.add(plane, grid(Page.color("grid")));
    scene.add(ground);
    render();
  }

  // Lines in pieces of a meter: some drivers leave out lines that begin behind the camera.
  function grid(color) {
    const ends = [];
    for (let i = -HALF; i <= HALF; i += 1) {
      for (let j = -HALF; j < HALF; j += 1) ends.push(i, j, 0, i, j + 1, 0, j, i, 0, j + 1, i, 0);
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(ends, 3));
    return new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color }));
  }

  function resize(place) {
    const { clientWidth: width, clientHeight: height } = place;
    if (!width || !height) return;
    renderer.setSize(width, height);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    render();
  }

  // Puts the camera where it sees a number of robots: beside a single one, farther off and more from ahead for more of them.
  function lookAt(count) {
    const away = 1 + 0.2 * (count - 1);
    const offset = count > 1 ? [2.4 * away, -3.2 * away, 1.4 * away] : [1.1, -3.6, 0.95];
    camera.position.copy(controls.target).add(new THREE.Vector3(...offset));
  }

  function turn(event) {
    const [around, over, times] = KEYS[event.key] || [];
    if (!times) return;
    event.preventDefault();
    const offset = camera.position.clone().sub(controls.target).applyAxisAngle(UP, around);
    offset.applyAxisAngle(offset.clone().cross(UP).normalize(), -over).multiplyScalar(times);
    camera.position.copy(controls.target).add(offset);
    controls.update();
  }

  // The number of a robot, which stays above it.
  function badge(number) {
    const canvas = Page.make("canvas", { width: 64, height: 64 });
    const context = canvas.getContext("2d");
    context.fillStyle = "#0b62a4";
    context.arc(32, 32, 31, 0, 7);
    context.fill();
    Object.assign(context, { fillStyle: "#ffffff", font: "bold 46px sans-serif", textAlign: "center", textBaseline: "middle" });
    context.fillText(number, 32, 35);
    const sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map: new THREE.CanvasTexture(canvas), depthTest: false }));
    sprite.scale.set(0.3, 0.3, 1);
    return sprite;
  }

  // Shows robots, each with its model and the links that it has lost; several have numbers.
  function show(robots) {
    for (const lane of lanes) {
      scene.remove(lane.outer);
      lane.robot.drop();
      if (lane.number) lane.number.material.map.dispose();
    }
    if (robots.length && robots.length !== seen) lookAt(robots.length);
    seen = robots.length || seen;
    lanes = robots.map(({ model, lost }, i) => {
      const robot = Robot.build(model, lost);
      const outer = new THREE.Group();
      outer.position.y = LANE * i;
      outer.add(robot.group);
      const number = robots.length > 1 ? badge(i + 1) : null;
      if (number) outer.add(number);
      scene.add(outer);
      return { robot, outer, number };
    });
    render();
  }

  // Poses every robot; the camera goes along with the first.
  function pose(poses) {
    if (!lanes.length) return;
    poses.forEach((values, i) => {
      const { robot, number } = lanes[i];
      robot.set(values);
      if (number) number.position.copy(robot.group.position).add(new THREE.Vector3(0, 0, 0.7));
    });
    const base = lanes[0].robot.group.position;
    const middle = new THREE.Vector3(base.x, base.y + (LANE * (lanes.length - 1)) / 2, MIDDLE);
    const moved = middle.clone().sub(controls.target);
    controls.target.copy(middle);
    camera.position.add(moved);
    ground.position.set(Math.round(base.x), Math.round(base.y), 0);
    sun.target.position.copy(middle);
    sun.position.set(middle.x - 2, middle.y - 3, 6);
    controls.update();
    render();
  }

  // Draws at the next frame, once, however many changes led to it.
  function render() {
    if (!renderer || waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      renderer.render(scene, camera);
    });
  }

  const joints = () => lanes.map((lane) => lane.robot.joints());

  return { open, show, pose, theme, joints };
})();
