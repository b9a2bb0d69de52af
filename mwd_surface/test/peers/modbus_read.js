// Reads the register map with modbus-serial: version, inclination, azimuth, depth, and the exception of the address
// after its end. Arguments: the port, and the number of registers where it is not that of version 2.
"use strict";
const ModbusRTU = require("modbus-serial");

async function main(port, count) {
  const client = new ModbusRTU();
  await client.connectTCP("127.0.0.1", { port });
  client.setID(1);
  client.setTimeout(5000);
  const { data, buffer } = await client.readInputRegisters(0, count);
  const number = (address) => buffer.readFloatBE(2 * address);
  let refused = 0;
  try {
    await client.readInputRegisters(count, 1);
  } catch (error) {
    refused = error.modbusCode;
  }
  console.log(data[0], number(10), number(12), number(14), refused);
  client.close(() => {});
}

main(Number(process.argv[2]), Number(process.argv[3] ?? 70)).catch((error) => {
  console.error(error);
  process.exit(1);
});
