"""A student's day: one simulated vehicle, from its log to the next gains. Runs after `pip install .`."""

from pathlib import Path

import control
import numpy as np

import quadid_logs as q

folder = Path("day")
folder.mkdir(exist_ok=True)

# Two flights of one vehicle. Of your own: the paths of their logs in place of these.
monday = q.simulate("doublets", seed=1, duration_s=40.0, rate_hz=400.0)
tuesday = q.simulate("doublets", seed=2, duration_s=40.0, rate_hz=400.0)

# Analyze: a verdict for each axis.
flight = q.analyze(monday)
print(flight)

# Table: every element of A and B with its 95 % interval; the aligned series by time.
flight.parameters.to_csv(folder / "parameters.csv")
series = flight.to_pandas()

# Plot: a figure of the report; in a notebook, `figure` as the last line of a cell shows it.
figure = flight.figures["fit"]
figure.save(folder / "fit.png")
axes = figure.to_matplotlib().axes  # an ordinary matplotlib figure, to change

# State space: python-control's, with named states; here without the delay, which goes apart.
model = flight.model
system = model.to_statespace(pade_order=0)
print(system.state_labels, "poles of the rates:", np.sort(system.poles().real)[-3:].round(2), "1/s")
time_s = np.arange(0.0, 0.5, 0.001)
response = control.forced_response(system, time_s, 0.01 * np.outer([1.0, 0.0, 0.0], time_s > 0.1))

# Simulate: the whole model, with lag and delay, on any torque [1].
torque = 0.01 * np.outer(time_s > 0.1, [1.0, 0.0, 0.0])
rates = model.simulate(torque, time_s)
print(f"roll rate after 0.4 s: {rates[-1, 0]:.2f} rad/s, linear {response.outputs[0, -1]:.2f} rad/s")

# Predict: another flight, to which nothing is fitted.
again = q.analyze(tuesday)
prediction = model.predict(again)
print(prediction)

# What the flight leaves open: vehicles drawn from it.
drawn = model.draws("roll", 1000)["effectiveness"]
print(f"roll effectiveness of 1000 drawn vehicles: {drawn.mean():.0f} +- {drawn.std():.1f} rad/s^2")

# Tune: the gains of the next flight; its margins, as flown.
tuning = q.tune(flight)
print(tuning)
print(f"roll, as flown: {flight.loop.margins['roll'].rate.phase_margin_deg.value:.0f} deg of phase margin")

# Compare: did the vehicle change from one flight to the other?
print(q.compare(flight, again))

# Report: the page and every number, to hand in.
q.write_report(flight, folder / "report", png="none", force=True)
