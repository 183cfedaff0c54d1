// The register table in the forms that people and PLCs read, all from firmware/modbus/register_table.h.
#pragma once

#include <string>

namespace finsight::host {

/// For the README: the measurements; commands and settings.
std::string measurements_markdown();
std::string control_markdown();

/// Comma-separated (RFC 4180, ASCII), for import by a PLC's programming tool.
std::string registers_csv();

/// IEC 61131-3 (third edition, without extensions): FB_Finsight scales the block, FB_FinsightCommand does the
/// handshake.
std::string structured_text();

/// Siemens SCL source for TIA Portal: a data type, a data block that the Modbus client fills, and the function that
/// scales.
std::string siemens_scl();

}  // namespace finsight::host
