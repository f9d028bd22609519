// What a page is made of and asks for, for `page check`.
{
  const engines = () => {
    const revision = sim.revision ?? window.__THREE__ ?? window.THREE?.REVISION;
    const found = {
      'A-Frame': window.AFRAME?.version,
      'three.js': revision && `r${revision}`,
      'Babylon.js': sim.babylonVersion(),
      PlayCanvas: window.pc?.version,
    };
    return filter(Object.entries(found), ({ 1: version }) => version).map((entry) => entry.join(' '));
  };
  const texts = (values) => map([...values].slice(0, 200), (value) => slice(String(value), 0, 100));
  sim.report = () => {
    for (const type of ['select', 'selectstart', 'selectend', 'squeeze', 'squeezestart', 'squeezeend']) {
      if (sim.session?.[`on${type}`]) sim.events.add(type);
    }
    return {
      engines: texts(engines()),
      sessions: texts(sim.modes),
      features: texts(sim.wishes),
      objects: texts(sim.names()),
      inputs: texts([...sim.events, ...sim.parts]),
    };
  };
}
