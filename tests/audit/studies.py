"""A small study on a two-joint arm, for the tests of this folder."""

STUDY = """\
name: small
plant: {engine: analytic, model: two-link, timestep: 0.002, integrator: rk4}
controllers:
  - {name: switching, law: smc, equivalent_control: true, switching: sign, gains: {lam: 10, k: 0.3}}
  - {name: band, law: linear-band-smc, equivalent_control: true, gains: {lam: 10, k: 0.3, phi: 0.3, kv: 20}}
  - {name: pd, law: pd, gains: {lam: 10, kv: 20}}
reference: {kind: sine, amplitude: [1.0, -0.8], frequency_hz: [0.5, 0.7]}
run: {duration: 2.0, control_period: 0.002, seed: 3}
audit:
  paper: {title: A band, authors: A. Author, published: "Journal 1, 1-9", year: 1999}
  open: [It prints no gains.]
  draws: 3
  conditions:
    chain:
      ideal: {chain: ideal}
      fast: {chain: fast}
    burden:
      nominal: {}
      wrong: {model.mismatch: {relative: 0.2}}
  claims:
    removes:
      says: The band removes the switching.
      where: Fig 1, torque over time
      quoted: no switching is left
      pairs: {band: [band, switching]}
      unlike: {a law without model: [pd, switching]}
      measures:
        - {figure: hf, as: ratio, below: 0.5, floor: 0.1, why: Half is seen}
        - {figure: rmse, below: 0.5, why: Half a radian is lost}
      under: {chain: all, burden: all}
      ablations: {PD: [pd, band]}
      ablated_under: {burden: wrong}
      expect: holds
    exact:
      says: The band has a hundredth of the error of switching.
      where: Fig 2, errors
      implied: Fig 2
      pairs: {band: [band, switching]}
      measures: [{figure: rmse, as: ratio, below: 0.01, why: A hundredth}]
      under: [{chain: fast, draws: 2}, {burden: nominal}]
      expect: fails
    growth:
      says: A wrong model costs nothing.
      where: Fig 3, errors
      quoted: insensitive
      pairs: {band: band}
      measures: [{figure: rmse, as: difference, against: {burden: nominal}, below: 1.0e-4, why: A tenth of a mrad}]
      under: {burden: wrong}
    reaches:
      says: Switching control is stable.
      where: Eq 4, the reaching condition
      quoted: stable
      pairs: {switching: switching}
      measures: [{figure: least_eta_over_K, as: share, counts: {above: 0}, above: 0.2, why: A fifth}]
      under: {burden: all}
    knows:
      says: The laws know the arm.
      where: Eq 5, equivalent control
      quoted: the model is used
      pairs: {band: band, PD: pd}
      measures: [{figure: feedforward, above: 0.5, why: Most of it}]
"""
