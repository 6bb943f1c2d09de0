"""What every finding means and what to do about it: the one text for report, `explain` and docs.

What to set on a certain autopilot stands in its folder (`Advice.remedies` by code), not here.

Codes: QL1xx the file, QL2xx the vehicle, QL3xx what was logged and how fast,
QL4xx the flight, QL5xx the model, QL6xx the loop.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

#: What its advice is: to be set before the next flight, the manoeuvre to fly, or anything else.
Step = Literal["set", "fly", "other"]
#: What it judges: the model of an axis, whose verdict it decides; the loop that the controller makes of the
#: vehicle, where the model is as good as it was; whether gains can be advised; or the state of the vehicle,
#: which decides no verdict.
Scope = Literal["model", "loop", "gains", "vehicle"]


@dataclass(frozen=True, slots=True, kw_only=True)
class CatalogueEntry:
    """A kind of finding: its title, what it means, what to fly or set next, and what it judges."""

    code: str
    title: str
    meaning: str
    advice: str
    step: Step
    scope: Scope


#: The doublets that are advised turn a vehicle at 14 to 25 deg/s rms (yaw least): an axis that turns more
#: lacks no excitation.
WELL_EXCITED_DEG_S: Final = 20.0
#: What helps an axis that lacks no excitation.
CALMER: Final = "Fly in calm air, away from the ground, with steady throttle and motors off their limits."
_ENOUGH: Final = (
    f"Look at the evidence. Below {WELL_EXCITED_DEG_S:g} deg/s rms, fly stronger manoeuvres on this axis. "
    f"Above, larger manoeuvres would not help. {CALMER}"
)

#: A vehicle that is at its limits in more of the samples needs less from its pilot, not other gains (QL617).
MOST_SATURATED: Final = 0.10
#: Stands in advice for the motor that a finding is about; a list of steps puts its name there.
THIS_MOTOR: Final = "this motor"

#: What makes an axis uncertain and its interval wide, and does not say that anything contradicts it.
CAVEATS: Final = frozenset(
    {"QL304", "QL403", "QL404", "QL503", "QL504", "QL505", "QL511", "QL514", "QL523", "QL524", "QL531"}
    | {"QL533", "QL534", "QL535"}
)


def _entry(
    code: str, title: str, meaning: str, advice: str, *, step: Step = "other", scope: Scope = "model"
) -> tuple[str, CatalogueEntry]:
    return code, CatalogueEntry(
        code=code, title=title, meaning=meaning, advice=advice, step=step, scope=scope
    )


CATALOGUE: Final[Mapping[str, CatalogueEntry]] = MappingProxyType(
    dict(
        (
            _entry(
                "QL101",
                "Part of the file could not be read",
                "Some bytes are not valid messages: the file was cut off, copied badly, or the card "
                "dropped blocks. Only the rows in those bytes are lost; the rest is used.",
                "If the lost part lies in the manoeuvre, download the log again or fly once more.",
            ),
            _entry(
                "QL102",
                "The autopilot dropped log messages",
                "The logger could not keep up and left messages out. The places show as gaps. Up to 50 ms "
                "are filled by a straight line; longer ones split the flight.",
                "Use a faster card, or log fewer message types.",
                step="set",
            ),
            _entry(
                "QL103",
                "The clock was reset or jumped",
                "Times fall or leap inside the file: a reboot, or a clock that was set. The parts are kept "
                "apart and shown one after the other.",
                "Nothing to do if each part is a flight of its own.",
            ),
            _entry(
                "QL104",
                "The log has no time column",
                "Its rows carry no time stamps (very old firmware), so no rate of change can be computed.",
                "Update the autopilot's firmware; any release of the last ten years stamps its rows.",
                step="set",
            ),
            _entry(
                "QL105",
                "Several systems are recorded in this file",
                "More than one vehicle or autopilot was recorded. One was chosen, the others are listed.",
                "Choose another one with --system ID.",
            ),
            _entry(
                "QL106",
                "Some rows were repaired or left out",
                "Some rows were out of order, repeated a time stamp, had an impossible one, or held no "
                "value, an absurd value or a spike of one sample. They were sorted, merged or left out.",
                "Nothing to do while it stays a small fraction of the rows.",
            ),
            _entry(
                "QL107",
                "Several logs are behind one model",
                "Their flights were put one after the other and fitted together. A change between them "
                "looks like a change in flight. Facts about the file are those of the first log.",
                "Nothing to do if all are of one vehicle in one state. To compare them, leave --pool out.",
            ),
            _entry(
                "QL201",
                "This is not a multirotor",
                "The model (torque to angular acceleration of a hovering body) does not describe "
                "aeroplanes, VTOLs, helicopters, rovers, boats or submarines, nor does this tool judge them.",
                "Use a log of a multirotor. For another vehicle, take its autopilot's own log viewer.",
            ),
            _entry(
                "QL202",
                "The log does not say what the vehicle is",
                "No message or parameter names the vehicle type, so it is taken for a multirotor.",
                "Check the report against what you flew.",
            ),
            _entry(
                "QL301",
                "The log holds no body rates",
                "Neither the rate controller's nor a gyro's angular rates were logged.",
                "Switch the logging of rates and IMU on.",
                step="set",
            ),
            _entry(
                "QL302",
                "The log holds no torque",
                "The log holds neither the torque that the autopilot commanded nor motor outputs that it "
                "could be rebuilt from, so there is no input to identify a model from.",
                "Log the rate controller's outputs.",
                step="set",
            ),
            _entry(
                "QL303",
                "Logged too slowly to identify anything",
                "Between two samples the torque and the rates change in ways that the log does not show. "
                "Interpolating gives inertias that are wrong by factors, so no number is given.",
                "Log rates and torque at 100 Hz or more.",
                step="set",
            ),
            _entry(
                "QL304",
                "Logged rather slowly",
                "The logging rate is high enough for the control effectiveness, but it hardly separates "
                "lag and effectiveness.",
                "Log rates and torque at 200 Hz or more.",
                step="set",
            ),
            _entry(
                "QL305",
                "The true rate is far below the nominal one",
                "Many samples are missing: the average rate of the signal is much lower than the time "
                "between neighbouring samples suggests.",
                "Use a faster card, or log fewer message types.",
                step="set",
            ),
            _entry(
                "QL306",
                "No attitude at a useful rate",
                "Only the structure with angles (linear-9) needs the attitude. It is left out, or its angles "
                "are interpolated.",
                "Nothing to do, unless you want linear-9: then log the attitude as fast as the body rates.",
                step="set",
            ),
            _entry(
                "QL307",
                "The mixer could not be recomputed",
                "The torque command, the parameters and the battery voltage determine the motor outputs. "
                "The outputs computed from them differ from the logged ones: this firmware mixes in "
                "another way, or the rows are too sparse to compare. The torque is used as it was "
                "commanded, and saturation is not detected.",
                "Log the rate controller's output, the motor outputs and the mixer's battery compensation "
                "with a current firmware to get the torque that was achieved.",
                step="set",
            ),
            _entry(
                "QL308",
                "Geometry parameters are not used as calibration",
                "The autopilot's mixer works with rotor positions and thrust coefficients in arbitrary "
                "units. Values that were never set, or that contradict the hover, do not measure this "
                "vehicle.",
                "Pass mass_kg, arm_length_m and torque_to_thrust_m with --vehicle FILE.toml.",
            ),
            _entry(
                "QL309",
                "The log does not describe the airframe",
                "Without the number, place and spin of the motors, nothing can be rebuilt from motor "
                "outputs. Torque commands, where they are logged, are used as they are.",
                "Describe the rotors with [[rotor]] tables in --vehicle FILE.toml.",
            ),
            _entry(
                "QL310",
                "Gyro and attitude contradict each other",
                "Over tenths of a second, the body rates must integrate to the change of roll, pitch and "
                "yaw. Here they do not: an axis has the wrong scale, sign or place, or one of the two "
                "comes late. One of them is wrong and the log alone does not show which; wrong rates make "
                "the control effectiveness wrong by the same factor.",
                "Check units, signs and order of the columns of a table. On an autopilot, check the "
                "orientation in which it is mounted, and whether its main loop keeps up.",
            ),
            _entry(
                "QL311",
                "Only the most excited minutes of this long flight were used",
                "Twenty minutes with the most motion hold nearly all information of a flight; the rest "
                "costs time only.",
                "Use --start-s and --end-s to analyze another part.",
            ),
            _entry(
                "QL312",
                "Rotor speeds and motor commands give different effectiveness",
                "The torque was computed from the rotor speeds and from the motor commands, and the same "
                "model was fitted to each. The two values differ by more than their intervals allow. The "
                "source that predicts validation data better was used.",
                "Check that each ESC reports its own motor, and the number of motor poles. A simulator may "
                "compute rotor speeds that its thrust does not follow.",
            ),
            _entry(
                "QL313",
                "The commanded thrust in newtons is wrong",
                "In steady flight the thrust of all motors carries the weight. Here the controller commands "
                "another thrust: the motors or propellers are not those that its firmware assumes. Its "
                "torque in newton metres is wrong by as much, so no inertia is given. Effectiveness per "
                "command, and the loop, are not affected.",
                "To get newtons, measure the thrust of a motor against its command.",
            ),
            _entry(
                "QL320",
                "No multirotor turns at these body rates",
                "Integrated, the rates turn the vehicle upside down for much of its flight, or they "
                "exceed what a gyro can measure. Usually the table holds deg/s where rad/s are needed, "
                "which makes every effectiveness 57 times too large.",
                "Give the body rates of a table in rad/s. Where the vehicle tumbled, choose the flight "
                "before that with --end-s. If it did fly like that, log the attitude too.",
            ),
            _entry(
                "QL321",
                "No rate set-points were used",
                "A controller answers gusts with torque, so torque and disturbance go together. Set-points "
                "do not answer gusts, so an estimate that rests on them is not biased. Without them the "
                "effectiveness may be too low by the fraction that its model leaves unexplained. The "
                "interval covers that.",
                "Log the rate set-points beside the rates.",
            ),
            _entry(
                "QL401",
                "No flight in this log",
                "Nothing in the log shows a flight: the vehicle did not fly, or the part with the flight "
                "is missing.",
                "Use a log with a flight of at least half a minute. If you did fly, fetch the whole file "
                "from the vehicle again.",
            ),
            _entry(
                "QL402",
                "The flight is too short",
                "There is less gap-free flight than a model and its check on validation data need.",
                "Fly for a minute with the manoeuvre, without landing in between. If --start-s or --end-s "
                "chose a part of the flight, choose a longer one.",
            ),
            _entry(
                "QL403",
                "This axis was poorly excited",
                "The motion of the axis is mostly noise and gusts, not a response to commands. A number "
                "fitted to that would look fine and be wrong.",
                "Excite this axis: quick stick doublets for half a minute, or a system-ID chirp.",
                step="fly",
            ),
            _entry(
                "QL404",
                "The torque does not explain all of the motion",
                "The torque explains most, but not nearly all, of the motion: the axis was weakly "
                "excited, or something other than torque moved it.",
                _ENOUGH,
                step="fly",
            ),
            _entry(
                "QL405",
                "The motors could not give the commanded torque",
                "For part of the flight a motor was at its limit and the mixer cut roll, pitch or yaw "
                "down. Where the torque was rebuilt from what the motors did, it already includes the "
                "cut, and nothing is lost. Where only the command is known, the samples around it are "
                "left out.",
                "Fly smaller manoeuvres, or with a throttle nearer to the middle.",
            ),
            _entry(
                "QL406",
                "A system-identification run is in this flight",
                "The autopilot injected a known excitation, which does not depend on gusts or noise. The "
                "estimate uses the motion that follows from it and leaves out the rest.",
                "Nothing to do. Only the axes that the run excites can be identified from it.",
            ),
            _entry(
                "QL420",
                "The torque holds little more than one frequency",
                "At one frequency, gain and phase are all that can be measured: effectiveness, damping, "
                "lag and delay cannot be told apart. With set-points the interval covers every lag that "
                "motors have. Without them a model error of 0.1 % becomes an error of 10 % in the "
                "effectiveness, so no number is given.",
                "Excite this axis at several frequencies: a chirp, doublets of different length, or at "
                "least three sinusoids over two octaves.",
            ),
            _entry(
                "QL430",
                "A motor gives less thrust than the others",
                "In steady flight one motor gets a higher command than the others, and both the position "
                "and the spin of this motor fit the difference. A weak motor, a damaged propeller or a "
                "wrong one explains it.",
                f"Look at the propeller and the bearings of {THIS_MOTOR}, and compare its speed with the "
                "others at the same command on the bench. Calibrate the ESCs.",
                scope="vehicle",
            ),
            _entry(
                "QL431",
                "A motor lost thrust during the flight",
                "From one moment on, one motor got a higher command than before, and both the position "
                "and the spin of this motor fit the difference. Load and wind do not turn the vehicle "
                "like that.",
                f"Do not fly before you have looked at {THIS_MOTOR}, its propeller and its ESC: feel whether "
                "they are hot, and turn the motor by hand.",
                scope="vehicle",
            ),
            _entry(
                "QL432",
                "A propeller is out of balance",
                "The gyro vibrates at the speed of one rotor more than at the speeds of all others together.",
                f"Replace or balance the propeller of {THIS_MOTOR}, then look at the motor's shaft and "
                "mount.",
                scope="vehicle",
            ),
            _entry(
                "QL433",
                "A motor lost its thrust for a moment",
                "For about a tenth of a second the vehicle turned as if half of one rotor's thrust or more "
                "were missing. That is how a desync of an ESC looks.",
                f"Look at the wires, solder joints and ESC of {THIS_MOTOR}. If they are sound, raise the "
                "ESC's timing or start-up power, and its demag compensation.",
                scope="vehicle",
            ),
            _entry(
                "QL434",
                "The centre of mass is not in the middle of the rotors",
                "The rotors on one side carry more weight than those on the other. If all rotors are alike, "
                "the centre of mass is on that side.",
                "Nothing to do while the motors of the two sides work alike within the normal range. "
                "Otherwise move the battery away from that side, until they do.",
                scope="vehicle",
            ),
            _entry(
                "QL435",
                "The accelerometer clipped",
                "In more than 100 samples the accelerometer was at the end of its range. The autopilot's "
                "attitude and height can be wrong then.",
                "Balance the propellers, and mount the flight controller softer.",
                scope="vehicle",
            ),
            _entry(
                "QL436",
                "A motor stood still while it was told to turn",
                "For a second or longer one motor turned less than half as fast as the slowest other, "
                "although its command was above the mean of the others. If the vehicle flew well meanwhile, "
                "only the speed reading is wrong.",
                "Take the propellers off and run each motor on the bench. If this one does not turn, look "
                "at its wires, solder joints, winding and ESC; if it does, look at the ESC's telemetry.",
                scope="vehicle",
            ),
            _entry(
                "QL501",
                "The short windows of the published method are filled with noise",
                "The published method solves each window of a few samples by itself. Consecutive samples "
                "differ by little more than noise, so the square matrix H_k of a window can barely be "
                "inverted. The models here are fitted to all data at once and do not suffer from it.",
                "Nothing to do for the model. Try --sample-rate-hz 20 and a wider --window to see the "
                "published method at its best.",
            ),
            _entry(
                "QL503",
                "The estimate depends on the frequency band",
                "Slow and fast motion give different values of the control effectiveness. A rigid body "
                "has only one: noise, wind, or feedback from the controller distorts at least one of "
                "them.",
                _ENOUGH,
                step="fly",
            ),
            _entry(
                "QL504",
                "The model fails on validation data",
                "On validation data, which the fit did not use, the model predicts the acceleration badly. "
                "Where air moved the vehicle as much as its commands did: no single effectiveness, lag and "
                "damping describe how it responded to its commands.",
                f"Do not use this axis. {_ENOUGH}",
                step="fly",
            ),
            _entry(
                "QL505",
                "The interval is too wide",
                "The data fit values of the control effectiveness that are far apart. Where the ends of "
                "the interval differ by less than a factor of 3, the number is given as a caution: it "
                "shows the order of magnitude only, and comparisons and tuning do not use it. Beyond that no "
                "number is given.",
                f"Fly longer. {_ENOUGH}",
                step="fly",
            ),
            _entry(
                "QL506",
                "The control effectiveness has the wrong sign",
                "More torque would turn the vehicle the other way. That is not physics: the signs of a "
                "signal are wrong, or the controller's feedback was identified instead of the vehicle.",
                "Fly larger stick doublets on this axis. If the sign stays wrong, check the signs of the "
                "columns of a table, or how the flight controller is turned on the frame.",
            ),
            _entry(
                "QL507",
                "The lag lies at the end of the searched range",
                "The best lag or delay is the largest that was tried, so it is not a motor's. Neither of "
                "them is identified.",
                "Check that torque and rates come from the same clock.",
            ),
            _entry(
                "QL509",
                "The control effectiveness differs between parts of the flight",
                "The effectiveness changed at one moment by more than chance allows: the vehicle changed "
                "(battery, payload, damage, a propeller), or something other than torque moved it. The "
                "interval covers the values before and after.",
                'Look at the figure "Window estimates over time", and analyze each part by itself with '
                "--start-s and --end-s.",
            ),
            _entry(
                "QL532",
                "The control effectiveness of both other axes changes in flight",
                "Battery, payload, propellers and loose parts change the effectiveness about all axes. "
                "This axis shows one value only, perhaps because it was commanded in only one part of the "
                "flight.",
                "Command this axis throughout the flight, and find out what changes the others.",
            ),
            _entry(
                "QL511",
                "The torque alone does not reproduce the motion",
                "Simulated over seconds from the logged torque, with the other two rates as measured, the "
                "rate differs from the measured one: wind or an imbalance moved the vehicle, and much of "
                "the torque is the controller's answer to that. An effectiveness fitted to such an answer "
                "is biased even if the fit looks good. An unstable model is checked only over the time for "
                "which its motion can be predicted.",
                _ENOUGH,
                step="fly",
            ),
            _entry(
                "QL510",
                "The torque is a normalised command",
                "The log holds no torque in N m. Effectiveness is per unit of command and no inertia in kg "
                "m^2 can be given.",
                "Describe the vehicle with --vehicle FILE.toml to get physical units.",
            ),
            _entry(
                "QL513",
                "Two formulations of the same equation disagree",
                "Integrated over quarters of a second (integral formulation) the equation of motion gives "
                "another effectiveness than smoothed with Gaussians (weak formulation). Both hold for a "
                "rigid body behind its actuators, so something else moved the vehicle, or torque and rates "
                "are not from one clock.",
                "Fly stronger manoeuvres on this axis, in calm air; check the clocks in the report.",
            ),
            _entry(
                "QL514",
                "The interval may be too narrow",
                "When blocks of the flight are drawn at random and fitted again, the effectiveness "
                "scatters by more than its interval says: single manoeuvres or gusts dominate the "
                "estimate.",
                "Fly longer, and repeat the manoeuvre evenly.",
            ),
            _entry(
                "QL515",
                "Real torque per commanded torque, by the inertia that was given",
                "The effectiveness times the given moment of inertia is the real torque over the commanded "
                "one, if that inertia is right. It is a calibration of the torque, not an inertia found in "
                "flight.",
                "Use the ratio to correct the commanded torque; a refused axis has none.",
            ),
            _entry(
                "QL516",
                "This log shows the controller reacting to disturbances, not the vehicle reacting to the "
                "controller",
                "Where most of the torque in the fitted band is, the response of acceleration to torque "
                "grows with frequency, and its phase is that of a growing response with the sign reversed "
                "(near -90 degrees where it grows in proportion). No vehicle does that. It is -1/C, the "
                "inverse of the controller: gusts or noise moved the vehicle, the controller answered, and "
                "the log shows the controller's gains. A higher band or a longer hover would show the same, "
                "with more confidence.",
                "Move the sticks more on this axis, so that commands move the vehicle more than air and "
                "noise do.",
                step="fly",
            ),
            _entry(
                "QL520",
                "The torque was computed from the rates",
                "The rates follow the torque without any lag, and fast changes of the torque have their "
                "full effect. Motors lag, and the gyro's filter delays. This torque is a derivative of "
                "the rates: its effectiveness repeats what was assumed when it was computed. Where roll "
                "or pitch shows it, no axis is judged.",
                "Log the torque that was commanded, or the motor outputs.",
            ),
            _entry(
                "QL521",
                "The torque leads to a rate, not to an acceleration",
                "A constant torque would turn the vehicle at a constant rate within a fraction of a "
                "second. Air does not damp a multirotor like that, a rate controller does: what is "
                "logged as torque lies before the controller, or is a set-point.",
                "Log the output of the rate controller, not what it is given.",
            ),
            _entry(
                "QL522",
                "The torque is stamped after the motion that it causes",
                "The flight is explained best where torque is taken from a later time than it is stamped "
                "with. Clocks of torque and rates differ, or the rates were smoothed in both directions. "
                "Lag and effectiveness are then biased low; the interval also covers the effectiveness "
                "that fits with the torque moved in time.",
                "Take torque and rates from one clock. Stamp each with the time at which it applied, not at "
                "which it was written.",
            ),
            _entry(
                "QL523",
                "Small torques have less effect",
                "Below some torque, or below some change of each rotor's command, the vehicle responds "
                "less than above it: a dead zone, friction, or coarse steps of the outputs. The "
                "effectiveness depends on the size of the manoeuvre. The interval covers the "
                "effectiveness outside the dead zone.",
                "Look for a dead band in the mixer or the ESCs. Manoeuvres well above it show "
                "the full effectiveness of this axis.",
            ),
            _entry(
                "QL524",
                "Large torques have less effect",
                "Above some torque, more command hardly adds motion: outputs are limited, and the log "
                "does not say so. The effectiveness of small torques is higher than the estimate; the "
                "interval covers it where it can.",
                "Log motor outputs as fast as the torque. Without them, keep the manoeuvres of this axis "
                "below the limit.",
            ),
            _entry(
                "QL525",
                "The response has a resonance",
                "Near one frequency the rates respond to the torque like something that bends or swings: "
                "an arm, a soft gyro mount, a load. A rigid body does not do that, and the effectiveness "
                "depends on the band.",
                "Stiffen what bends, or put a notch at its frequency. Do not raise gains.",
            ),
            _entry(
                "QL526",
                "A moment that grows with the tilt turns the vehicle",
                "The vehicle's own tilt turns it: a pendulum below the centre of mass, a sling load, or "
                "an unstable shape in the wind of its own speed. The model leaves this moment out; the "
                "interval is wide enough to allow for it.",
                "Fly quicker manoeuvres without load, or use only faster motion.",
            ),
            _entry(
                "QL527",
                "The motors do not respond with a single lag",
                "The torque does not build up like that of one first-order lag: rotors spin down more "
                "slowly than up, or another filter lies between. The interval is wide enough to allow for "
                "that.",
                "Log the motor outputs, and describe the rotors with --vehicle FILE.toml, where either is "
                "missing.",
            ),
            _entry(
                "QL528",
                "The control effectiveness varies in flight",
                "The thrust per command varies (battery, throttle, ground, another controller), or "
                "something other than torque moves the vehicle. The residual persists from one half "
                "second to the next, or grows and shrinks with the modelled motion; noise does neither.",
                'Look at the figure "Window estimates over time". Fly the manoeuvre at one throttle, far from'
                " the ground.",
            ),
            _entry(
                "QL529",
                "The flights are not of one vehicle in one state",
                "The flights, fitted one by one, differ in control effectiveness by more than their "
                "intervals allow. The common value describes none of them.",
                "Analyze the flights by themselves: without --pool, or with --start-s and --end-s.",
            ),
            _entry(
                "QL530",
                "The thrust curve is not the one that the autopilot assumes",
                "The effectiveness changes with thrust as if the thrust curve had another expo than the "
                "parameter says. The torque was rebuilt with the expo that fits, so the effectiveness holds "
                "at the mean thrust of the manoeuvre. With the autopilot's expo the loop gain changes with "
                "throttle.",
                "Set the expo of the thrust curve to the value found; check the tuning with small inputs.",
            ),
            _entry(
                "QL531",
                "Yaw was identified from a slow log",
                "Rates and torque were logged too slowly for roll and pitch. Yaw is slow enough: its "
                "response to set-points between 0.3 and 2.5 Hz gives its effectiveness. The interval "
                "allows 5 % for what happened between the samples. Validation data cannot confirm it, "
                "because gusts move the vehicle as much as its commands do.",
                "Compare this yaw only with flights that were logged alike. A model that can be confirmed "
                "takes a faster log.",
            ),
            _entry(
                "QL533",
                "The log does not rule out a dead zone or a limit that would make the effectiveness higher",
                "The flight hints at a dead zone or a limit that is not logged, but too weakly to exclude "
                "chance. It would change the effectiveness by more than a tenth. The interval covers "
                "that.",
                "Fly the manoeuvre once more, twice as long, half of it gently and half of it with strong "
                "commands: chance averages out, and a real effect becomes clear.",
            ),
            _entry(
                "QL534",
                "The torque was logged in coarse steps",
                "The logged torque takes whole steps only. Where it was cut toward zero, as a cast to "
                "whole numbers does, it is too small and the effectiveness too high. Where it was "
                "rounded, the effectiveness is right. Where the commands show that it was cut, what was "
                "cut is put back; elsewhere the interval covers both.",
                "Log the torque with more digits, and fly the manoeuvre with larger commands.",
            ),
            _entry(
                "QL535",
                "The effectiveness comes from the response to commands alone",
                "Gusts moved this axis as much as its commands did, or an effect of the rotors or of the "
                "logging makes a sample-by-sample fit too low. Gusts do not change the commands, so the "
                "response to commands still gives effectiveness, damping and lag: from spectra of short "
                "segments, each frequency weighted by how little of it is gust. Dead zones, limits and "
                "other effects are taken out where the flight shows them. Where the flight leaves them "
                "open, the interval covers them. Where several pooled flights repeat one trajectory, and "
                "their logs hold a velocity, what they have in common counts as the command.",
                "Fly in calmer air, or make larger and quicker manoeuvres, for a narrower interval.",
                step="fly",
            ),
            _entry(
                "QL536",
                "The vehicle's balance moved in flight: a motor may have lost thrust",
                "The thrust that holds the vehicle level moved to another place during the flight. A load "
                "that slips does that, and so does a motor that loses thrust. A motor that gives less lowers "
                "the effectiveness of the axes that it turns. The evidence gives the effectiveness "
                "afterwards as a fraction of that before. The interval holds both.",
                "Before the next flight, look at the motors, the propellers and the load. For a narrower "
                "interval, analyze the flight before and after the change separately, with --start-s and "
                "--end-s.",
            ),
            _entry(
                "QL512",
                "The inertia is implausible for a multirotor",
                "A body's largest moment of inertia is at most the sum of the other two, and a "
                "multirotor's lie well within its mass times the square of its arm. The result breaks "
                "these bounds by more than its interval: mass, arm, thrust or the torque-to-thrust ratio "
                "is not this vehicle's.",
                "Check the numbers in the vehicle file against the figure of the airframe.",
            ),
            _entry(
                "QL601",
                "The control loop has little margin",
                "Good loops keep 6 dB, 45 degrees and a disk margin of 0.67 with 97.5 % confidence. Below "
                "4 dB or 30 degrees a loop is close to instability: a lighter vehicle, a fuller battery "
                "or a little more delay can make it oscillate. Gains that are too high cost margin, and "
                "so can gains that are too low.",
                "`quadid-log tune LOG` computes the next gains, or says why it cannot.",
                scope="loop",
            ),
            _entry(
                "QL602",
                "The open-loop and the closed-loop estimate of the effectiveness disagree",
                "Simulated from the set-points, model and controller reproduce the measured torque only "
                "with another control effectiveness than the one identified from torque and rates. One of "
                "the two is biased: the controller is not the one of the parameters, or something other "
                "than torque moved the vehicle.",
                "Check that no gain was changed in flight, and fly the manoeuvres of this axis again, in "
                "calm air.",
            ),
            _entry(
                "QL603",
                "The measured response contradicts the model around the crossover",
                "Around the crossover frequency, which decides about stability, the measured response of "
                "the rate to the torque differs from the model's. The model holds at the lower "
                "frequencies where it was fitted; the margins depend on the higher ones.",
                "Do not rely on the margins of this axis. A system-ID chirp up to twice the crossover shows "
                "the loop itself.",
                scope="loop",
            ),
            _entry(
                "QL604",
                "The controller reconstructed from the logged parameters does not reproduce the logged "
                "output",
                "Replayed from logged set-points and rates, the controller does not give the logged terms "
                "and torque. So its loop is not judged.",
                "Keep the gains as they are during the flight, and log the controller's terms at the loop's "
                "rate.",
                scope="loop",
            ),
            _entry(
                "QL605",
                "The margins rest on frequencies that were not measured",
                "The loop's stability depends on frequencies above those that the flight shows. Something "
                "unmeasured may take phase away there: the margins' intervals allow for a low-pass, up to 9 "
                "degrees. A bending frame may add gain: they allow for the modes that the log does not "
                "rule out.",
                "Fly a system-ID chirp up to twice the crossover, or quicker manoeuvres.",
                scope="loop",
            ),
            _entry(
                "QL606",
                "The control law is that of another firmware version",
                "The control law of this firmware version is not known to this tool. The law of the "
                "nearest known version was used.",
                "Compare the release notes of the rate controller between the two versions.",
                scope="loop",
            ),
            _entry(
                "QL607",
                "A peak above the fitted band bounds the gain margin",
                "The spectrum of the rate has a peak there, strong or weak: an arm, a mount or a load that "
                "bends, or a propeller. What bends adds gain to the loop. The gain margin and its interval "
                "allow for it. A log that is slower than the loop may show faster vibration there, as of a "
                "propeller's blades.",
                "Look for what bends or is loose, and stiffen it; or put a notch at that frequency if a log "
                "at the rate of the loop shows the peak, too. Do not raise P or D before that.",
                scope="loop",
            ),
            _entry(
                "QL650",
                "The attitude controller reconstructed from the logged parameters does not reproduce the "
                "logged rate set-points",
                "Replayed from logged attitudes and their set-points, the attitude controller does not "
                "give the logged rate set-points. The margins with the angle loop then hold for another "
                "gain, and no margins of the velocity loop are given.",
                "Check that no gain of the attitude controller was changed in flight, and fly once more.",
                scope="loop",
            ),
            _entry(
                "QL651",
                "The position or velocity controller reconstructed from the logged parameters does not "
                "reproduce the logged targets",
                "Replayed from logged positions, velocities and their set-points, the controller does not "
                "give the logged targets: the gain that fits differs from the logged one by more than 10 "
                "%. Some firmware lowers these gains by itself, as with optical flow, and a flight at the "
                "limit of tilt or speed looks alike. No margin of the velocity loop is given.",
                "Check that no gain of these controllers was changed in flight. Fly once more in calm air.",
                scope="loop",
            ),
            _entry(
                "QL652",
                "The velocity loop is close to instability",
                "The velocity and position controllers of the parameters, closed around the attitude loop, "
                "leave less than 30 degrees or 4 dB. It shows as a slow sway of some seconds while the "
                "vehicle holds a position.",
                "Fly by attitude until this is cleared. Compare the gains of the position and velocity "
                "controllers with the firmware's defaults.",
                scope="loop",
            ),
            _entry(
                "QL653",
                "The attitude answers too slowly for the velocity loop",
                "The bandwidth of the attitude is less than 2.5 times the crossover frequency of the "
                "velocity loop. The attitude then takes more than 22 degrees of phase from it.",
                "Tune the attitude before the velocity loop: `quadid-log tune LOG`.",
                scope="loop",
            ),
            _entry(
                "QL654",
                "The vehicle did not follow its velocity set-point",
                "The velocity was off its set-point by more than the set-point itself moved: a vehicle "
                "that did not respond at all would have come nearer. Wind, tilt limits, or a swaying "
                "velocity loop cause that.",
                "Look at the tilt limit and at the wind of that flight.",
                scope="loop",
            ),
            _entry(
                "QL655",
                "No margins of the velocity and position loops are given",
                "The log holds messages of the position controller, but the tool cannot close these loops "
                "around the model: a gain is unknown, the rows are too few or too slow, or the attitude "
                "loop inside is not known well enough.",
                "Log all parameters, and fly manoeuvres that make roll and pitch usable.",
                scope="loop",
            ),
            _entry(
                "QL610",
                "No gains are recommended for this vehicle",
                "Gains are recommended for multirotors with the rate controllers of the autopilots that are "
                "read here. This is another autopilot, or a vehicle that also flies as something else.",
                "Tune it by its own autopilot's instructions.",
                scope="gains",
            ),
            _entry(
                "QL611",
                "The controller cannot be reconstructed from the logged parameters",
                "Parameters of the rate controller are missing in the log, are no numbers, or switch on "
                "what is not modelled.",
                "Log all parameters, and fly with the standard rate controller.",
                step="set",
                scope="gains",
            ),
            _entry(
                "QL612",
                "The controller reconstructed from the logged parameters does not reproduce the logged "
                "output",
                "Replayed from logged set-points and rates, the controller does not give the logged terms "
                "and torque: gains computed for it would suit another controller.",
                "Read what differs under QL604, and fly once more with gains that stay as they are.",
                scope="gains",
            ),
            _entry(
                "QL613",
                "The controller could not be checked against the log",
                "Set-points, rates and torque were logged too slowly, or with a clock that was reset, so "
                "that the controller cannot be replayed. No gain is changed without that check.",
                "Log rates, set-points and the controller's output at the loop's rate, and fly once more.",
                step="set",
                scope="gains",
            ),
            _entry(
                "QL614",
                "The measured response contradicts the model at the crossover",
                "Around the crossover frequency, which decides about stability, the measured response "
                "differs from the model's (QL603).",
                "Fly a system-ID chirp up to twice the crossover and tune from that flight.",
                scope="gains",
            ),
            _entry(
                "QL615",
                "The model of this axis is not usable",
                "Gains follow from the model, and findings say why this one cannot be trusted. Their "
                "codes are listed with the axis.",
                "Take the next steps that `quadid-log analyze LOG` prints, and tune from the new flight.",
                scope="gains",
            ),
            _entry(
                "QL616",
                "The slew limiter scaled the gains down",
                "P and D were scaled down in flight, or may have been, which the log does not show: the "
                "gains of the parameters are not those that flew.",
                "Log the controller's terms, which show how often the limiter acted. Fly gently enough that "
                "it stays out, and tune from that flight.",
                scope="gains",
            ),
            _entry(
                "QL617",
                "The mixer was at its limits",
                "In more than a tenth of the flight this axis got less torque than was commanded. Other "
                "gains do not change that, and the model cannot predict what they would do.",
                "Fly gentler manoeuvres, or use a lighter vehicle or stronger motors.",
                scope="gains",
            ),
            _entry(
                "QL618",
                "The model is too uncertain to change gains",
                "With the estimated model, the margins meet their limits. In the worst case within the "
                "intervals of effectiveness, lag and delay, the loop is close to instability. Other gains "
                "may help or harm.",
                "Fly stronger manoeuvres for longer, in calm air, with fast logging.",
                scope="gains",
            ),
            _entry(
                "QL619",
                "Part of the vehicle bends or swings",
                "The model's residual shows a flexible mode (QL525): an arm, a damper or a payload. Gains "
                "that suit the model may drive it.",
                "Stiffen or fix it, or put a notch on it, and fly once more.",
                scope="gains",
            ),
            _entry(
                "QL620",
                "The phase of a notch is not known",
                "A notch follows a frequency that neither the parameters nor the log hold, and the body "
                "rates were logged before it. The phase that it takes is missing in the margins.",
                "Log the body rates behind the filters, or what the notch follows. Or fix the notch at one "
                "frequency, fly once more, and tune from that flight.",
                step="set",
                scope="gains",
            ),
            _entry(
                "QL621",
                "The firmware version that flew is unknown",
                "The log does not say which version of the control law flew.",
                "Fly with a current firmware: it writes its version into the log.",
                step="set",
                scope="gains",
            ),
            _entry(
                "QL622",
                "The gains were changed after the part that was analyzed",
                "The vehicle no longer has the gains that flew here, so a change computed from them would "
                "be wrong.",
                "Tune from a flight with the gains that are set now.",
                scope="gains",
            ),
            _entry(
                "QL623",
                "Several logs are behind this model",
                "They may be of several vehicles, or flown with several sets of gains.",
                "Tune from one flight.",
                scope="gains",
            ),
            _entry(
                "QL626",
                "This flight and an earlier one tell of two vehicles",
                "The model of this axis differs from that of an earlier flight by more than their intervals "
                "and what differs between flights of one vehicle. Either something changed, or one of the "
                "flights misleads.",
                "Look for what changed. If nothing did, fly the manoeuvre once more. If something did, leave "
                "out the earlier flights.",
                scope="gains",
            ),
            _entry(
                "QL627",
                "This flight shows too little of this axis: the gains follow from earlier flights",
                "No model of this axis can be identified from this flight, and nothing in it contradicts the "
                "model of earlier flights. The intervals are theirs, wider by what differs between flights.",
                "Load the file, and heed the warning beside these gains. For narrower intervals fly stronger "
                "manoeuvres on this axis, or in calmer air, and give all of these logs with `--earlier` when "
                "you tune from the next one.",
                scope="gains",
            ),
            _entry(
                "QL624",
                "No common factor of P, I and D brings the margins to their limits",
                "Neither higher nor lower gains meet the margins: filters, angle loop or motors take too "
                "much phase.",
                "Keep the gains. Where a filter limits this axis, QL636 names it and its cut-off.",
                scope="gains",
            ),
            _entry(
                "QL625",
                "There is no stable loop to start from",
                "With the flown gains, the loop around the model is not known, or it is unstable although "
                "the vehicle flew: gains or model are not those of this flight.",
                "Look at the findings about the loop.",
                scope="gains",
            ),
            _entry(
                "QL630",
                "Lower these gains: they leave too little margin for the next flight",
                "In the worst case that has to be expected on the next flight, the flown gains leave less "
                "margin than required. Lower gains leave more.",
                "Load the file, hover first, and heed the warning beside these gains.",
                scope="gains",
            ),
            _entry(
                "QL631",
                "Raise these gains: they reject gusts better, and margins stay above the limits",
                "Even in the worst case within the uncertainty of this flight, there is more margin than "
                "required.",
                "Load the file, hover first, and heed the warning beside these gains.",
                scope="gains",
            ),
            _entry(
                "QL660",
                "Raise these gains: they leave too little margin for the next flight",
                "The rate loop is so slow that the angle loop around it lacks phase: the flown gains have "
                "less margin than required, and higher ones have more.",
                "Load the file, hover first, and heed the warning beside these gains.",
                scope="gains",
            ),
            _entry(
                "QL632",
                "Gyro noise limits the gains",
                "With higher gains the gyro's noise would move the motors by more than a twentieth of their "
                "range.",
                "Reduce vibration: balance propellers, mount the autopilot softly, put notches on the "
                "motors' speeds.",
                scope="gains",
            ),
            _entry(
                "QL633",
                "One step at a time",
                "The gains go on towards their target in further flights: above the crossover the "
                "controller's response at most doubles from flight to flight, and no margin falls below the "
                "limits.",
                "Fly the file, and tune again from that flight.",
                scope="gains",
            ),
            _entry(
                "QL634",
                "The gains are right as they are",
                "No change of more than a few per cent would be worth a flight.",
                "Keep the gains.",
                scope="gains",
            ),
            _entry(
                "QL635",
                "Motor limits cap the gains",
                "In more than a twentieth of the flight this axis got less torque than was commanded: "
                "higher gains would only reach the limits sooner.",
                "Fly gentler manoeuvres for tuning.",
                scope="gains",
            ),
            _entry(
                "QL636",
                "A filter, not the gain, limits this vehicle",
                "The delay of a low-pass takes most of the phase: with a higher cut-off the same gains "
                "would keep more margin, at the price of more noise.",
                "Raise the cut-off in small steps where vibration allows it, and tune again.",
                scope="gains",
            ),
            _entry(
                "QL637",
                "The documented range limits the gains",
                "The firmware documents no higher value of this parameter.",
                "Keep the value, or read the firmware's documentation on it.",
                scope="gains",
            ),
            _entry(
                "QL638",
                "No common factor of P, I and D reaches the required margins",
                "The recommended gains come closer to the required margins than the flown ones. Filters, "
                "angle loop or motors take the rest.",
                "Where a filter limits this axis, QL636 names it and its cut-off.",
                scope="gains",
            ),
            _entry(
                "QL639",
                "The promise rests on frequencies that were not measured",
                "Above what the flight shows, the promised margins allow for a low-pass that takes up to 9 "
                "degrees, and for modes of the frame that the log does not rule out.",
                "Fly a system-ID chirp up to twice the crossover for a narrower promise.",
                scope="gains",
            ),
            _entry(
                "QL670",
                "Change filters and gains together: they reject gusts better or make less noise, and "
                "margins stay above the limits",
                "A filter costs phase, and that limits the gains. These filters and gains together leave "
                "less gust error, or less noise on the motors, than any gains with the flown filters.",
                "Load the file as a whole: these gains belong to these filters. Hover first, and feel the "
                "motors after half a minute: they must stay cool.",
                scope="gains",
            ),
            _entry(
                "QL671",
                "There is too much filtering",
                "A low-pass cuts lower than the noise of this gyro requires, and costs phase for nothing.",
                "Set the cut-off in the file, with its gains.",
                scope="gains",
            ),
            _entry(
                "QL672",
                "There is too little filtering",
                "The low-pass lets too much noise through to the motors. The phase that it saves is not "
                "worth that.",
                "Set the cut-off in the file, with its gains.",
                scope="gains",
            ),
            _entry(
                "QL673",
                "The notches miss the vibration lines of the gyro",
                "A notch beside the lines costs phase for nothing. A line without a notch shakes the motors.",
                "Set the notches as in the file, and restart the autopilot before the flight.",
                scope="gains",
            ),
            _entry(
                "QL674",
                "The filters stay as they flew",
                "Other filters are recommended only where they help: no axis gets more gust error than "
                "with new gains alone, and one axis gets 5 % less gust error or noise. No setting that "
                "was tried does that, or all axes share the filters and one of them has no model, or a notch "
                "follows a frequency that the log does not hold.",
                "Load the gains. Leave the filters.",
                scope="gains",
            ),
            _entry(
                "QL675",
                "Off-nominal margins break a limit",
                "With another battery, load, air or propeller the same command turns the vehicle more or "
                "less. In the named conditions, the worst case within the uncertainty of this flight "
                "falls below the limits. The gains are not lowered for that alone.",
                "Fly in the conditions of this flight, or tune again from a flight in the named condition.",
                scope="gains",
            ),
            _entry(
                "QL676",
                "A gain lies below its documented range",
                "The margins ask for less of this gain than this version of the firmware documents as its "
                "lowest value. The firmware takes it; a ground station may ask first.",
                "Load the value, and confirm it where the ground station asks.",
                scope="gains",
            ),
            _entry(
                "QL641",
                "P, I, D and the angle gain change by different factors",
                "Each gain is set where gusts are rejected best: margins are kept, noise stays "
                "acceptable, and the attitude follows its set-point no more slowly. One common factor on "
                "P, I and D would do worse.",
                "Load the file, hover first, and heed the warning beside these gains.",
                scope="gains",
            ),
            _entry(
                "QL643",
                "An angle loop that is not modelled flew around the rate loop",
                "In a self-levelling mode the angle loop takes phase from the rate loop. This log does not "
                "tell how rates are made from angles: no gains are recommended from such a flight.",
                "Fly the whole flight in a mode in which the sticks command rates, and tune from that.",
                scope="gains",
            ),
            _entry(
                "QL644",
                "The log's rounding hides the controller",
                "Rates, set-points and terms are logged as whole numbers, and the flight was so calm that "
                "they hardly rise above their rounding: they neither confirm nor contradict the controller. "
                "No gain is changed without that check.",
                "Fly quick manoeuvres, and log with a higher resolution where the autopilot can.",
                scope="gains",
            ),
            _entry(
                "QL642",
                "Some terms of the controller were not replayed",
                "P, and D where the log is fast enough, were recomputed from set-points and rates and "
                "agree. The named terms were taken as logged: moving sticks, limits and the throttle "
                "change them in ways that the log does not show. Margins use the gains of the settings "
                "and hold for sticks at rest.",
                "Nothing to do; for D, log at 1 kHz or more.",
                scope="loop",
            ),
            _entry(
                "QL640",
                "The log does not show the noise of the command",
                "The torque was logged too slowly to see what the gyro's noise does to it, so the gains "
                "are not raised.",
                "Log the controller's output at the loop's rate.",
                scope="gains",
            ),
            _entry(
                "QL646",
                "This flight does not show whether other gains would be better",
                "With the estimated model, the margins meet their limits. In the worst case that has to "
                "be expected on the next flight, they do not. The intervals are too wide to raise the "
                "gains, and give no reason to lower them.",
                "Keep the gains. For narrower intervals fly the manoeuvre again, longer, in calmer air, and "
                "give this log with `--earlier` when you tune from the next one.",
            ),
            _entry(
                "QL647",
                "A more precise model would allow better gains",
                "If the vehicle were exactly as estimated, other gains would reject gusts better by a "
                "quarter or more. In the worst case that has to be expected on the next flight, they "
                "would not keep the margins.",
                "Keep the gains. To go further, fly longer, in calmer air, with manoeuvres that reach twice "
                "the crossover, and give this log with `--earlier` when you tune from the next one.",
                scope="gains",
            ),
            _entry(
                "QL648",
                "A first step by rule, for an axis that oscillates without a model",
                "No model of this axis can be trusted, and it oscillates without a command. A loop that "
                "oscillates is at its limit; half of its gain is 6 dB away. No margin is promised.",
                "Load the file, hover short and low, and run tune on that log. If it still oscillates, "
                "halve again. If it feels sluggish, load the back file.",
                scope="gains",
            ),
            _entry(
                "QL645",
                "The log does not rule out that the frame bends",
                "A frame that bends above the fitted band would take gain margin. This log is too slow, too "
                "short or too noisy to show it. That is no reason to lower the gains, nor to raise them.",
                "Log rates and torque at 400 Hz or more, and fly for a minute; or give this log with "
                "`--earlier` when you tune from the next one.",
                scope="gains",
            ),
        )
    )
)
