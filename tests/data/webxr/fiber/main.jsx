// React Three Fiber: two boxes whose state changes every few frames, and a log of when what ran.
import { createRoot } from 'react-dom/client';
import { useCallback, useEffect, useRef, useState } from 'react';
import { Canvas, useFrame, useThree } from '@react-three/fiber';

const app = window.app = { log: [], entries: 0, digest: 7, renders: 0, frames: 0 };
const note = (...what) => {
  app.log.push([...what, performance.now().toFixed(3)].join(' '));
  app.entries = app.log.length;
  for (const one of app.log.at(-1)) app.digest = (app.digest * 31 + one.charCodeAt()) % 1e9;
};

function Box({ name, x }) {
  const mesh = useRef();
  const [count, setCount] = useState(0);
  useEffect(() => note('effect', name, count), [name, count]);
  useFrame((state, seconds) => {
    app.frames += 1;
    mesh.current.rotation.y += seconds;
    if (app.frames % 10 === 0) setCount((before) => before + 1);
  });
  app.renders += 1;
  return (
    <mesh ref={mesh} name={name} position={[x, 1.2, -1]}>
      <boxGeometry args={[0.2, 0.2, 0.2]} />
      <meshBasicMaterial color={count % 2 ? 'orange' : 'red'} />
    </mesh>
  );
}

function Enter({ register }) {
  const { gl } = useThree();
  useEffect(() => {
    gl.xr.enabled = true;
    register(() => navigator.xr.requestSession('immersive-vr', { optionalFeatures: ['local-floor'] })
      .then((session) => gl.xr.setSession(session)));
  }, [gl, register]);
  return null;
}

function App() {
  const [enter, setEnter] = useState(null);
  const register = useCallback((go) => setEnter(() => go), []);
  useEffect(() => note('app', Boolean(enter)), [enter]);
  return (
    <>
      {enter && <button onClick={() => { note('click'); enter(); }}>Enter VR</button>}
      <div style={{ height: '60vh' }}>
        <Canvas onCreated={() => note('created')}>
          <Box name="left" x={-0.3} />
          <Box name="right" x={0.3} />
          <Enter register={register} />
        </Canvas>
      </div>
    </>
  );
}
createRoot(document.querySelector('#root')).render(<App />);
