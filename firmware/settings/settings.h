// The board file: what one device needs to know beside its model pack. Strict: see TomlTable.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "firmware/input_error.h"
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

/// Of finsight-page, the commissioning page; finsightd publishes for it.
struct PageSettings {
  std::string address = "127.0.0.1";                    ///< IPv4 address to listen on; "0.0.0.0" for all
  int port = 80;                                        ///< of the first finger; the others' follow it
  bool local_link_only = false;                         ///< answers do not pass a router
  std::vector<Network> allow = {};                      ///< who may look; empty: everybody
  std::vector<Network> allow_writes = {};               ///< who of them may write with the key; empty: all
  std::vector<std::string> names = {};                  ///< that browsers may call the device by, besides its addresses
  std::filesystem::path folder = "/run/finsight-page";  ///< of the published block
  std::filesystem::path measured = {};                  ///< where the page stores lens, mount and fit; empty: nowhere
  std::filesystem::path updates = {};                   ///< where it puts updates down; empty: there are none
};
/// In PageSettings::folder: what finsightd has said last, and before that.
inline constexpr const char *kLogName = "log", *kLogBefore = "log.1";
/// In PageSettings::measured. They replace those of the board file or session.
inline constexpr const char *kMeasuredLens = "lens.toml", *kMeasuredMount = "mount.toml", *kMeasuredFit = "fit.toml";
/// Settings and zero that were imported: at its next start finsightd saves them as its own and removes the file.
inline constexpr const char* kImportedState = "state.toml";

/// Of one finger, with what it shares with the board's others.
struct Settings {
  std::string name;                    ///< of the finger; empty: it is the board's only one
  int unit = 255;                      ///< under which it is reached over Modbus TCP
  std::optional<InputError> unusable;  ///< of a file beside the board file that this one of several fingers needs
  std::filesystem::path pack;
  enum class Source { kSession, kPoses, kCamera } source = Source::kSession;
  ReplaySettings replay;      ///< of a session or poses
  LiveCameraSettings camera;  ///< of a camera
  Lens lens;                  ///< of a camera; a session brings its own
  std::optional<GpioSettings> gpio;
  std::filesystem::path measured_lens;  ///< to be used instead of the source's lens; empty: none
  std::string fit_where;                ///< where loop.fit was read, for messages
  bool fit_is_stored = false;           ///< on the page: one of another pack is ignored instead of refused
  std::optional<MeasuredMount> mount;   ///< of this device; the model's if it was not measured
  LoopSettings loop{.shape = {.tier = ShapeSettings::Tier::kBest},
                    .runtime = {}};  ///< its runtime settings are the factory settings
  ModbusSettings modbus;
  std::uint16_t write_key = kDefaultWriteKey;
  std::filesystem::path saved_state;  ///< what clients save; empty: nothing can be saved
  std::filesystem::path recordings;   ///< where sessions are recorded; empty: nowhere
  int record_max_s = 600;             ///< a recording ends by itself after this
  int record_reserve_mb = 100;        ///< room on the disk that recordings leave free
  std::optional<Vec3f> fixed_g;       ///< see LoopSettings; nothing: the board file does not say it
  int gravity_max_age_ms = 0;         ///< how long gravity written by a client holds; 0: no client writes it
  RealtimeSettings realtime;
  NetworkSettings network;
  std::optional<PageSettings> page;                   ///< nothing: there is no page
  std::string serial_number;                          ///< empty: the board's own
  std::uint32_t calibration_date = 0;                 ///< as 20261122; 0: that of the newest of measured_files
  std::vector<std::filesystem::path> measured_files;  ///< that lens and mount come from
};

/// The board file with the user's file, if there is one, over it. Each is parsed once; all readers share them.
class SettingsFiles {
 public:
  /// Never throws InputError: merged() does.
  SettingsFiles(const std::filesystem::path& board, const std::filesystem::path& user = {});

  /// Throws InputError for a file that is missing or not TOML.
  TomlTable merged() const;
  /// What there is, best first: the merged files, the board file alone. Without those that are not TOML.
  const std::vector<TomlTable>& versions() const { return versions_; }

 private:
  std::vector<TomlTable> versions_;
  std::optional<InputError> error_;
};

/// Whether lens, mount and fit that are stored under page.measured are read. The page, which mends them, ignores them.
enum class Measured { kUsed, kIgnored };

/// Of every finger, in the order of their unit ids: 1 to 4. Without [[finger]] the file is that of one finger. A
/// [[finger]] table says what the file of one finger says of it, and what it leaves out is that of the file's top; what
/// it stores goes under its name. Strict: throws InputError with file:line, key, found and expected, also for what two
/// fingers cannot share. A lens, mount or fit in a file of its own that cannot be used is `unusable` of its [[finger]].
/// Relative paths start at the folder of the file that they stand in.
std::vector<Settings> read_fingers(const SettingsFiles& files, Measured measured = Measured::kUsed);
/// Of the first finger.
Settings read_settings(const SettingsFiles& files);

/// [network] alone, whatever the rest is like: a device that cannot work must still be found in the network. Throws
/// InputError like read_fingers().
NetworkSettings read_network_settings(const SettingsFiles& files);

/// For when read_fingers() fails: [modbus], [storage] and [gpio], each on its own. Where the user's is not valid, the
/// board file's; where that is not valid either, the default (Modbus on 0.0.0.0:502, nothing saved, no outputs). Never
/// throws InputError.
Settings read_usable_settings(const SettingsFiles& files);

/// The same for each finger of the file, of which [gpio] is taken from its own table where that is valid.
std::vector<Settings> read_usable_fingers(const SettingsFiles& files);
/// [gpio] of a board file, or of a [[finger]] table over it; nothing if it has none. Throws InputError.
std::optional<GpioSettings> read_outputs(TomlTable root);

/// One finger's: of a whole board file, or of a [[finger]] table over it.
Settings read_finger(TomlTable root, const std::string& name, Measured measured);

}  // namespace finsight
