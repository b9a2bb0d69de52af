// Browses to variables of a well by name with node-opcua-client and prints value, status, time and unit of each.
"use strict";
const { OPCUAClient, AttributeIds, makeBrowsePath } = require("node-opcua-client");

async function main(endpoint, namespace, well, ...names) {
  const client = OPCUAClient.create({ endpointMustExist: false, connectionStrategy: { maxRetry: 1 } });
  await client.connect(endpoint);
  const session = await client.createSession();
  const index = (await session.readNamespaceArray()).indexOf(namespace);
  const find = async (path) => {
    const { statusCode, targets } = await session.translateBrowsePath(makeBrowsePath("ObjectsFolder", path));
    if (!statusCode.isGood()) throw new Error(`${path}: ${statusCode}`);
    return targets[0].targetId;
  };
  const found = [];
  for (const name of names) {
    const path = `/${index}:${well}/${index}:${name}`;
    const value = await session.read({ nodeId: await find(path), attributeId: AttributeIds.Value });
    const unit = await session.read({ nodeId: await find(`${path}.EngineeringUnits`), attributeId: AttributeIds.Value });
    found.push({
      value: value.value.value,
      status: value.statusCode.name,
      source: value.sourceTimestamp ? value.sourceTimestamp.getTime() : null,
      unit: unit.value.value.displayName.text,
    });
  }
  await session.close();
  await client.disconnect();
  console.log(JSON.stringify(found));
}

main(...process.argv.slice(2)).catch((error) => {
  console.error(error);
  process.exit(1);
});
