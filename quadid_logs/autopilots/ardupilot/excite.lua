-- Body of excite.lua: the settings stand above it. All of it is made for ArduCopter's scripting
-- interface (libraries/AP_Scripting/docs/docs.lua). Parameters are set with param:set, which saves nothing: a
-- restart brings back what was there, too.

local STABILIZE, ALT_HOLD, GUIDED, LAND, SYSTEM_ID = 0, 2, 4, 9, 25
local NAMES = { "SID_AXIS", "SID_MAGNITUDE", "SID_F_START_HZ", "SID_F_STOP_HZ", "SID_T_FADE_IN", "SID_T_REC",
                "SID_T_FADE_OUT" }
local WARNING, INFO = 4, 6
local TICK_MS, WATCH_MS = 10, 100
-- System ID mode waits for a second before its sweep begins.
local SYSTEM_ID_WAIT_MS, BEFORE_RETURN_MS, REST_MS = 1000, 300, 3000
-- Without a sweep of its own the mode has to run once with axis 0, so that it has stopped before others return.
local STOPPED_MS = 100

local state, since = "idle", millis()
local flown, home_mode, entered, start_height_m = nil, nil, nil, nil
local number, must_release, reason = 0, true, ""

local function tell(severity, text)
  gcs:send_text(severity, "excite: " .. text)
end

local function enter(next_state)
  state, since = next_state, millis()
end

local function elapsed_ms()
  return (millis() - since):tofloat()
end

-- 4.7 renamed the angles; both are in radians.
local function roll_pitch()
  if ahrs.get_roll_rad then
    return ahrs:get_roll_rad(), ahrs:get_pitch_rad()
  end
  return ahrs:get_roll(), ahrs:get_pitch()
end

local function height_m()
  local down_m = ahrs:get_relative_position_D_home()
  return down_m and -down_m or nil
end

-- Says what forbids to go on, nil if nothing does.
local function danger()
  if rc:get_aux_cached(SWITCH) ~= 2 then return "switch" end
  if not arming:is_armed() then return "disarmed" end
  if not rc:has_valid_input() then return "radio link" end
  local roll, pitch = roll_pitch()
  if math.cos(roll) * math.cos(pitch) < math.cos(math.rad(MOST_TILT_DEG)) then return "tilt" end
  local height = height_m()
  if height == nil or height < LEAST_HEIGHT_M or height > MOST_HEIGHT_M then return "height" end
  if start_height_m and math.abs(height - start_height_m) > MOST_CLIMB_M then return "height" end
  if battery:has_failsafed() then return "battery" end
  local left = battery:capacity_remaining_pct(0)
  if left and left < LEAST_BATTERY_PERCENT then return "battery" end
  return nil
end

local function set(name, value)
  if not param:set(name, value) then return false end
  local back = param:get(name)
  return back ~= nil and math.abs(back - value) <= 1e-4 * math.max(1e-3, math.abs(value))
end

-- Remembers what is set on the vehicle; false where a parameter is missing.
local function remember()
  local found = {}
  for _, name in ipairs(NAMES) do
    found[name] = param:get(name)
    if found[name] == nil then return false end
  end
  flown = found
  return true
end

-- Sets a sweep while the mode does not run: the axis, which makes it possible, comes last.
local function load_sweep(sweep)
  if vehicle:get_mode() == SYSTEM_ID then return false end
  if sweep.SID_MAGNITUDE > sweep.limit or sweep.SID_MAGNITUDE <= 0 then return false end
  if not set("SID_AXIS", 0) then return false end
  for _, name in ipairs(NAMES) do
    if name ~= "SID_AXIS" and not set(name, sweep[name]) then return false end
  end
  return set("SID_AXIS", sweep.SID_AXIS)
end

local function finish(why)
  reason = why
  param:set("SID_AXIS", 0)
  logger:write("QIDX", "Phase,Num,Axis,Mag", "NBBf", "end", number, 0, 0)
  enter("stopping")
end

-- Goes to a mode that this script chooses.
local function choose(mode)
  if not vehicle:set_mode(mode) then return false end
  entered = mode
  return true
end

-- Leaves a mode that this script has entered; one that pilot or failsafe have chosen stays.
local function leave()
  local mode = vehicle:get_mode()
  if mode ~= entered or mode == home_mode then return true end
  local refuge = reason == "radio link" and LAND or home_mode
  return choose(refuge) or choose(ALT_HOLD) or choose(STABILIZE) or choose(LAND)
end

local function stop()
  -- First of all the sweep: what has been set as the magnitude of another test may be a hundred times as large.
  local quiet = set("SID_AXIS", 0)
  local left = leave()
  if not quiet or elapsed_ms() < STOPPED_MS then return end
  if not left and elapsed_ms() < 10 * STOPPED_MS then return end
  enter("restoring")
end

local function restore()
  for _, name in ipairs(NAMES) do
    if name ~= "SID_AXIS" and not set(name, flown[name]) then return end
  end
  if not set("SID_AXIS", flown.SID_AXIS) then return end
  tell(INFO, "parameters are as they were; ended by " .. reason)
  flown, home_mode, entered, start_height_m, must_release = nil, nil, nil, nil, true
  enter("idle")
end

local function idle()
  if rc:get_aux_cached(SWITCH) ~= 2 then
    must_release = false
    return
  end
  if must_release then return end
  must_release = true
  start_height_m = nil
  local why = danger()
  local mode = vehicle:get_mode()
  if mode ~= STABILIZE and mode ~= ALT_HOLD then why = why or "mode: fly Stabilize or AltHold" end
  if why == nil and not remember() then why = "firmware without System ID mode" end
  if why then
    tell(WARNING, "not started: " .. why)
    return
  end
  home_mode, start_height_m, number = mode, height_m(), 1
  tell(INFO, "begins; the switch ends it")
  enter("resting")
end

local function rest()
  if vehicle:get_mode() ~= home_mode then return finish("mode") end
  if elapsed_ms() < REST_MS then return end
  local sweep = SWEEPS[number]
  if sweep == nil then
    if FLY_MULTISINE and vehicle.set_target_rate_and_throttle and choose(GUIDED) then
      logger:write("QIDX", "Phase,Num,Axis,Mag", "NBBf", "multisine", number, 0, 0)
      return enter("multisine")
    end
    return finish("its end")
  end
  if not load_sweep(sweep) then return finish("parameter") end
  if not choose(SYSTEM_ID) then return finish("mode") end
  logger:write("QIDX", "Phase,Num,Axis,Mag", "NBBf", "sweep", number, sweep.SID_AXIS, sweep.SID_MAGNITUDE)
  tell(INFO, sweep.name)
  enter("sweeping")
end

local function sweep()
  local flying = SWEEPS[number]
  if vehicle:get_mode() ~= SYSTEM_ID then return finish("mode") end
  local magnitude = param:get("SID_MAGNITUDE")
  if magnitude == nil or magnitude > 1.001 * flying.limit then return finish("magnitude") end
  if elapsed_ms() < SYSTEM_ID_WAIT_MS + 1000 * flying.SID_T_REC + BEFORE_RETURN_MS then return end
  if not set("SID_AXIS", 0) or not choose(home_mode) then return finish("mode") end
  number = number + 1
  enter("resting")
end

local function clamp(value, limit)
  return math.max(-limit, math.min(limit, value))
end

-- Fades in over a second, so that nothing jumps; whole periods after it are periodic.
local function wave(axis, time_s)
  local sum = 0
  for _, line in ipairs(MULTISINE.lines[axis]) do
    sum = sum + math.sin(2 * math.pi * line[1] * time_s + line[2])
  end
  return clamp(MULTISINE.scale_dps[axis] * sum * math.min(1, time_s), MULTISINE.limit_dps[axis])
end

local function stick(name)
  local channel = rc:get_channel(param:get(name) or 0)
  return channel and channel:norm_input_dz() or 0
end

local function multisine()
  if vehicle:get_mode() ~= GUIDED then return finish("mode") end
  local time_s = elapsed_ms() / 1000
  if time_s > 1 + MULTISINE.periods * MULTISINE.period_s then return finish("its end") end
  local roll, pitch = roll_pitch()
  local velocity, hover = ahrs:get_velocity_NED(), param:get("MOT_THST_HOVER")
  if velocity == nil or hover == nil then return finish("height") end
  local added = { wave(1, time_s), wave(2, time_s), wave(3, time_s) }
  -- The sticks lean it by 15 degrees at most, as in Stabilize; height is held around the start.
  local lean, back = math.rad(15) * stick("RCMAP_ROLL"), math.rad(15) * stick("RCMAP_PITCH")
  local climb = 0.06 * velocity:z() + 0.04 * (start_height_m - height_m())
  local throttle = math.max(0.5 * hover, math.min(1.5 * hover, (hover + climb) / (math.cos(roll) * math.cos(pitch))))
  local accepted = vehicle:set_target_rate_and_throttle(
    added[1] + 2 * math.deg(lean - roll), added[2] + 2 * math.deg(back - pitch),
    added[3] + 45 * stick("RCMAP_YAW"), throttle)
  if not accepted then return finish("mode") end
  logger:write("QIDM", "Time,P,Q,R,Thr", "fffff", time_s, added[1], added[2], added[3], throttle)
end

local STATES = { idle = idle, resting = rest, sweeping = sweep, multisine = multisine, stopping = stop,
                 restoring = restore }

local function act()
  if state == "resting" or state == "sweeping" or state == "multisine" then
    local why = danger()
    if why then
      tell(WARNING, "stops: " .. why)
      finish(why)
    end
  end
  STATES[state]()
end

-- An error of the script ends the test as any other danger does; one while it stops is tried again.
function update()
  local ok, message = pcall(act)
  if not ok then
    tell(WARNING, tostring(message))
    if flown and state ~= "stopping" and state ~= "restoring" then
      reason = "an error"
      enter("stopping")
    end
  end
  return update, state == "idle" and WATCH_MS or TICK_MS
end

tell(INFO, "ready; switch option " .. SWITCH)
return update()
