// The board file: what one device needs to know beside its model pack. Strict: see TomlTable.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "firmware/loop/frame_loop.h"
#include "firmware/modbus/server.h"
#include "firmware/ports/camera.h"
#include "firmware/ports/gpio.h"
#include "firmware/settings/measured_mount.h"
#include "firmware/shape/shape_stage.h"

namespace finsight {

struct RealtimeSettings {
  int priority = 0;  ///< of SCHED_FIFO; 0: the ordinary scheduler
  int cpu = -1;      ///< the processor that the frame loop stays on; -1: any
  bool lock_memory = false;
};

struct NetworkSettings {
  std::string address;  ///< with prefix length; empty: from a DHCP server
  std::string gateway;  ///< empty: none
};

struct Settings {
  std::filesystem::path pack;
  enum class Source { kSession, kPoses, kCamera } source = Source::kSession;
  ReplaySettings replay;      ///< of a session or poses
  LiveCameraSettings camera;  ///< of a camera,
  CameraModel lens;           ///< and what it sees through
  std::optional<GpioSettings> gpio;
  std::optional<MeasuredMount> mount;  ///< of this device; the model's where it was not measured
  LoopSettings loop;                   ///< its live settings are the factory's, until others were saved
  ModbusSettings modbus;
  std::uint16_t write_key = kDefaultWriteKey;
  std::filesystem::path saved_state;  ///< what clients save; empty: nothing can be saved
  std::filesystem::path recordings;   ///< where sessions are recorded; empty: none are
  RealtimeSettings realtime;
  NetworkSettings network;
};

/// Throws InputError with file:line, key, found and expected. Relative paths start at the file's folder. Values of
/// `user`, when it is given, take the place of the board file's.
Settings read_settings(const std::filesystem::path& file, const std::filesystem::path& user = {});

/// [network] alone, however the rest is: a device that cannot work should still be found. Throws InputError like
/// read_settings().
NetworkSettings read_network_settings(const std::filesystem::path& file, const std::filesystem::path& user = {});

/// For when read_settings() fails: [modbus] and [gpio], each by itself; where the user's is bad the board file's, and
/// the default (Modbus on 0.0.0.0:502, no outputs) where that is bad too. Never throws InputError.
Settings read_good_parts(const std::filesystem::path& file, const std::filesystem::path& user = {});

/// The intrinsics that a session was recorded with, as the vision stages want them.
CameraModel camera_of(const SessionInfo& session);

}  // namespace finsight
