// The register table as a Node-RED flow: the nodes as they are, their JavaScript and their addresses from the table.
#include <span>
#include <sstream>
#include <string_view>

#include "firmware/modbus/control.h"
#include "hostgen/plc/plc_files.h"
#include "hostgen/plc/row_text.h"

namespace finsight::host {

namespace {

std::string converted(const RegisterRow& row, int first) {
  const std::string at = std::to_string(row.address - first);
  if (is_float(row)) return std::string("real(") + at + ")";
  if (words_of(row.type) == 2) return std::string("pair(") + at + ")";
  std::ostringstream text;
  text << (row.type == RegisterType::kInt16 ? "signed(w[" + at + "])" : "w[" + at + "]");
  if (row.scale != 1) text << " / " << 1 / row.scale;
  return text.str();
}

std::string bit(const RegisterRow& row, const NamedValue& value, int first) {
  return std::string("bit(") + std::to_string(row.address - first) + ", " + std::to_string(value.value) + ")";
}

std::string value_or_null(const RegisterRow& row, int first) {
  if (!row.may_be_invalid() || is_float(row)) return converted(row, first);  // real() gives null for NaN
  const char* const invalid = row.type == RegisterType::kInt16 ? "0x8000" : "0xFFFF";
  return std::string("w[") + std::to_string(row.address - first) + "] === " + invalid +
         " ? null : " + converted(row, first);
}

/// `name_text`: what a code means, in words.
std::string code_text(const RegisterRow& row, int first) {
  std::string names;
  for (const NamedValue& value : row.values) {
    if (!names.empty()) names += ", ";
    names += std::to_string(value.value) + ": '" + label_of(value) + "'";
  }
  return std::string("  ") + row.name + "_text: {" + names + "}[w[" + std::to_string(row.address - first) + "]],\n";
}

/// The values of a block, of which w[0] is the first register.
std::string values_of(std::span<const RegisterRow> rows) {
  const int first = rows.front().address;
  std::ostringstream text;
  for (const RegisterRow& row : rows) {
    if (is_reserved(row)) continue;
    if (is_bits(row)) {
      for (const NamedValue& value : row.values) {
        text << "  " << variable_of(row, value) << ": " << bit(row, value, first) << ",\n";
      }
      continue;
    }
    text << "  " << variable_of(row) << ": " << value_or_null(row, first) << ",\n";
    if (row.kind == RegisterKind::kCode) text << code_text(row, first);
  }
  return text.str();
}

/// The same for the block of all fingers, which has single words only.
std::string gripper_scaling(const RegisterTable& table) {
  return std::string("// ") + kOrigin +
         "\nconst w = msg.payload;\nconst bit = (r, n) => (w[r] >> n & 1) === 1;\n"
         "const signed = v => v > 32767 ? v - 65536 : v;\nmsg.payload = {\n" +
         values_of(table.gathered) + "};\nreturn msg;";
}

/// JavaScript of the node that scales a block: variables have the names that they have in Structured Text.
std::string scaling(const RegisterTable& table) {
  std::ostringstream text;
  text << "// " << kOrigin
       << "\n"
          "const w = msg.payload;\n"
          "const bit = (r, n) => (w[r] >> n & 1) === 1;\n"
          "const signed = v => v > 32767 ? v - 65536 : v;\n"
       << "const lowWordFirst = w[" << address_of("test_constant_long") << "] === " << (kLongTestConstant & 0xFFFF)
       << ";\n"
          "const pair = r => lowWordFirst ? w[r + 1] * 65536 + w[r] : w[r] * 65536 + w[r + 1];\n"
          "const real = r => {\n"
          "  const bytes = Buffer.alloc(4);\n"
          "  bytes.writeUInt32BE(pair(r));\n"
          "  const value = bytes.readFloatBE(0);\n"
          "  return Number.isNaN(value) ? null : value;\n"
          "};\n"
          "msg.payload = {\n";
  text << values_of(table.measurements);
  text << "};\nreturn msg;";
  return text.str();
}

/// As a string of JSON.
std::string json_string(std::string_view text) {
  std::string json = "\"";
  for (const char c : text) {
    if (c == '\n') {
      json += "\\n";
    } else {
      if (c == '"' || c == '\\') json += '\\';
      json += c;
    }
  }
  return json + "\"";
}

// Numbers 20000 to 29999 are this flow's; one that another client has used would be refused.
constexpr const char* kNewNumber = R"(const last = flow.get('number') || 20000 + Math.floor(Math.random() * 9999);
const number = last < 29999 ? last + 1 : 20000;
flow.set('number', number);
msg.payload = [msg.payload, number];
return msg;)";
constexpr const char* kOwnResult = R"(const [number, command, result] = msg.payload;
const isOurs = number === flow.get('number') && number !== flow.get('told');
if (!isOurs || result === $RUNNING) return null;
flow.set('told', number);
msg.payload = {command, result};
return msg;)";

// $NAME stands for what comes from the table.
constexpr const char* kFlow = R"([
 {"id": "finsight-tab", "type": "tab", "label": "Finsight"},
 {"id": "finsight-dev", "type": "modbus-client", "name": "finger", "clienttype": "tcp", "bufferCommands": true,
  "stateLogEnabled": false, "queueLogEnabled": false, "failureLogEnabled": true,
  "tcpHost": "192.168.1.50", "tcpPort": "502", "tcpType": "DEFAULT",
  "serialPort": "/dev/ttyUSB", "serialType": "RTU-BUFFERD", "serialBaudrate": "9600", "serialDatabits": "8",
  "serialStopbits": "1", "serialParity": "none", "serialConnectionDelay": "100",
  "serialAsciiResponseStartDelimiter": "",
  "unit_id": "1", "commandDelay": "1", "clientTimeout": "1000", "reconnectOnTimeout": true,
  "reconnectTimeout": "2000", "parallelUnitIdsAllowed": true},
 {"id": "finsight-read", "type": "modbus-read", "z": "finsight-tab", "name": "measurements", "topic": "",
  "showStatusActivities": false, "logIOActivities": false, "showErrors": true, "showWarnings": true, "unitid": "1",
  "dataType": "InputRegister", "adr": "0", "quantity": "$MEASUREMENTS", "rate": "100", "rateUnit": "ms",
  "delayOnStart": false, "startDelayTime": "", "server": "finsight-dev", "useIOFile": false, "ioFile": "",
  "useIOForPayload": false, "emptyMsgOnFail": false, "wires": [["finsight-scale"], []], "x": 400, "y": 80},
 {"id": "finsight-scale", "type": "function", "z": "finsight-tab", "name": "scale",
  "func": $SCALING,
  "outputs": 1, "wires": [["finsight-show"]], "x": 550, "y": 80},
 {"id": "finsight-show", "type": "debug", "z": "finsight-tab", "name": "show", "active": true, "tosidebar": true,
  "console": false, "complete": "payload", "wires": [], "x": 700, "y": 80},
 {"id": "finsight-read-all", "type": "modbus-read", "z": "finsight-tab", "name": "all fingers", "topic": "",
  "showStatusActivities": false, "logIOActivities": false, "showErrors": true, "showWarnings": true, "unitid": "1",
  "dataType": "InputRegister", "adr": "$GATHERED_ADDRESS", "quantity": "$GATHERED", "rate": "100", "rateUnit": "ms",
  "delayOnStart": false, "startDelayTime": "", "server": "finsight-dev", "useIOFile": false, "ioFile": "",
  "useIOForPayload": false, "emptyMsgOnFail": false, "wires": [["finsight-scale-all"], []], "x": 400, "y": 480},
 {"id": "finsight-scale-all", "type": "function", "z": "finsight-tab", "name": "scale",
  "func": $GRIPPER_SCALING,
  "outputs": 1, "wires": [["finsight-show-all"]], "x": 550, "y": 480},
 {"id": "finsight-show-all", "type": "debug", "z": "finsight-tab", "name": "show all fingers", "active": false,
  "tosidebar": true, "console": false, "complete": "payload", "wires": [], "x": 750, "y": 480},
 {"id": "finsight-go", "type": "inject", "z": "finsight-tab", "once": false, "onceDelay": 2, "repeat": "",
  "payload": "$KEY", "payloadType": "num", "wires": [["finsight-unlock"]], "x": 100, "y": 160,
  "name": "set hold_time to 200 ms: unlock, then write"},
 {"id": "finsight-unlock", "type": "modbus-write", "z": "finsight-tab", "name": "unlock",
  "showStatusActivities": false, "showErrors": true, "unitid": "1", "dataType": "HoldingRegister",
  "adr": "$KEY_ADDRESS", "quantity": "1", "server": "finsight-dev", "emptyMsgOnFail": true,
  "keepMsgProperties": false, "wires": [["finsight-set"], ["finsight-w1"]], "x": 250, "y": 160},
 {"id": "finsight-w1", "type": "debug", "z": "finsight-tab", "name": "unlocked", "active": true, "tosidebar": true,
  "console": false, "complete": "payload", "wires": [], "x": 400, "y": 160},
 {"id": "finsight-set", "type": "function", "z": "finsight-tab", "func": "msg.payload = [200, 0];\nreturn msg;",
  "outputs": 1, "wires": [["finsight-write"]], "x": 550, "y": 160, "name": "hold_time, after_hold"},
 {"id": "finsight-write", "type": "modbus-write", "z": "finsight-tab", "name": "hold_time",
  "showStatusActivities": false, "showErrors": true, "unitid": "1", "dataType": "MHoldingRegisters",
  "adr": "$HOLD_TIME_ADDRESS", "quantity": "2", "server": "finsight-dev", "emptyMsgOnFail": true,
  "wires": [["finsight-w2"], []], "x": 700, "y": 160},
 {"id": "finsight-order", "type": "inject", "z": "finsight-tab", "once": false, "onceDelay": 2, "repeat": "",
  "payload": "$TARE", "payloadType": "num", "wires": [["finsight-number"]], "x": 100, "y": 320,
  "name": "command: tare the deformation; unlock first"
},
 {"id": "finsight-number", "type": "function", "z": "finsight-tab", "name": "command and a new number",
  "func": $NEW_NUMBER,
  "outputs": 1, "wires": [["finsight-command"]], "x": 350, "y": 320},
 {"id": "finsight-command", "type": "modbus-write", "z": "finsight-tab", "name": "command",
  "showStatusActivities": false, "showErrors": true, "unitid": "1", "dataType": "MHoldingRegisters",
  "adr": "$COMMAND_ADDRESS", "quantity": "2", "server": "finsight-dev", "emptyMsgOnFail": true,
  "wires": [["finsight-w2"], []], "x": 600, "y": 320},
 {"id": "finsight-own", "type": "modbus-read", "z": "finsight-tab", "name": "own number, command, result", "topic": "",
  "showStatusActivities": false, "logIOActivities": false, "showErrors": true, "showWarnings": true, "unitid": "1",
  "dataType": "HoldingRegister", "adr": "$OWN_ADDRESS", "quantity": "3", "rate": "200", "rateUnit": "ms",
  "delayOnStart": false, "startDelayTime": "", "server": "finsight-dev", "useIOFile": false, "ioFile": "",
  "useIOForPayload": false, "emptyMsgOnFail": false, "wires": [["finsight-result"], []], "x": 400, "y": 400},
 {"id": "finsight-result", "type": "function", "z": "finsight-tab", "name": "result of ours",
  "func": $OWN_RESULT,
  "outputs": 1, "wires": [["finsight-w2"]], "x": 600, "y": 400},
 {"id": "finsight-w2", "type": "debug", "z": "finsight-tab", "name": "written", "active": true, "tosidebar": true,
  "console": false, "complete": "payload", "wires": [], "x": 100, "y": 240}
]
)";

}  // namespace

std::string node_red_flow(const RegisterTable& table) {
  std::string flow = kFlow;
  const auto fill_in = [&flow](std::string_view name, const std::string& value) {
    const std::size_t at = flow.find(name);
    flow = flow.substr(0, at) + value + flow.substr(at + name.size());
  };
  fill_in("$MEASUREMENTS", std::to_string(kMeasurementRegisters));
  fill_in("$GATHERED_ADDRESS", std::to_string(kGatheredAddress));
  fill_in("$GATHERED", std::to_string(kGatheredRegisters));
  fill_in("$GRIPPER_SCALING", json_string(gripper_scaling(table)));
  fill_in("$SCALING", json_string(scaling(table)));
  fill_in("$KEY_ADDRESS", std::to_string(kKeyRegister));
  fill_in("$KEY", std::to_string(kDefaultWriteKey));
  fill_in("$TARE", std::to_string(value_named("command", "tare_deformation")));
  fill_in("$COMMAND_ADDRESS", std::to_string(kCommandRegister));
  fill_in("$OWN_ADDRESS", std::to_string(address_of("own_sequence")));
  fill_in("$NEW_NUMBER", json_string(kNewNumber));
  fill_in("$OWN_RESULT", json_string(kOwnResult));
  fill_in("$RUNNING", std::to_string(value_named("own_result", "running")));
  fill_in("$HOLD_TIME_ADDRESS", std::to_string(address_of("hold_time")));
  return flow;
}

}  // namespace finsight::host
