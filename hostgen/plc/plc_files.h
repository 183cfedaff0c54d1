// The register table (firmware/modbus/register_table.h) in the forms that people, PLCs and finsightctl read.
// Names, types, scales and values come from the table's data; its descriptions end up in comments and columns of prose
// only. Every function takes the table as an argument so that tests can vary it.
#pragma once

#include <string>

#include "firmware/modbus/register_table.h"

namespace finsight::host {

/// Markdown tables: the measurements; commands and settings; process helpers; the history of commands; the block of all
/// fingers; diagnostics.
std::string measurements_markdown(const RegisterTable& table = kRegisterTable);
std::string control_markdown(const RegisterTable& table = kRegisterTable);
std::string process_markdown(const RegisterTable& table = kRegisterTable);
std::string history_markdown(const RegisterTable& table = kRegisterTable);
std::string gathered_markdown(const RegisterTable& table = kRegisterTable);
std::string diagnostics_markdown(const RegisterTable& table = kRegisterTable);

/// A Markdown table of faults: cause, effect, what ends them, what to do.
std::string faults_markdown(const RegisterTable& table = kRegisterTable);

/// Comma-separated values (RFC 4180, ASCII), for import into a PLC's programming tool. Column `invalid` holds the value
/// that means "not valid", column `values` bits and codes as "0=ready;1=touch_valid".
std::string registers_csv(const RegisterTable& table = kRegisterTable);

/// IEC 61131-3, third edition, without extensions: FB_Finsight scales the measurements, FB_FinsightCommand carries out
/// the command handshake.
std::string structured_text(const RegisterTable& table = kRegisterTable);

/// SCL source for Siemens TIA Portal: a data type, a data block that the Modbus client fills, the function blocks for
/// scaling and commands, and an example with MB_CLIENT.
std::string siemens_scl(const RegisterTable& table = kRegisterTable);

/// An Add-On Instruction for Rockwell's Logix controllers, as Studio 5000 exports one.
std::string rockwell_l5x(const RegisterTable& table = kRegisterTable);

/// Tags for Kepware (CSV import below a Modbus device) and Ignition (CSV import of tags; device name Finsight).
std::string kepware_csv(const RegisterTable& table = kRegisterTable);
std::string ignition_csv(const RegisterTable& table = kRegisterTable);

/// A Node-RED flow (node-red-contrib-modbus) that reads and scales the measurements, unlocks, and writes a setting.
std::string node_red_flow(const RegisterTable& table = kRegisterTable);

/// The table as Python source, for scripts/finsightctl, which is one file that needs nothing else.
std::string finsightctl_table(const RegisterTable& table = kRegisterTable);

/// `text` with `content` between the line that contains "BEGIN GENERATED name" and the line that contains
/// "END GENERATED name". Throws std::runtime_error if one of the two is missing.
std::string with_section(const std::string& text, const std::string& name, const std::string& content);

}  // namespace finsight::host
