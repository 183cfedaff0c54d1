// A lawful Modbus client beside attackers of a running firmware.
#pragma once

#include <nlohmann/json_fwd.hpp>

namespace finsight::host {

/// Attacks the server on 127.0.0.1:`port` in each way for `seconds`, and first in none ("alone"). Per attack: the times
/// of a client at 127.0.0.9 that reads 48 registers a thousand times a second (microseconds; the worst in ms), how many
/// of the attack's actions there were in a second, heartbeats in a second, and the shares of one processor that server
/// (process `pid`), attackers and client took. Throws std::runtime_error if the lawful client is not served.
nlohmann::json measure_attacks(int port, int pid, double seconds);

}  // namespace finsight::host
