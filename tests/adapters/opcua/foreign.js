// An OPC UA server of node-opcua with a value, a bad one and a history, on the port in argv[2].
const { OPCUAServer } = require("node-opcua-server");
const { OPCUACertificateManager } = require("node-opcua-certificate-manager");
const { Variant, DataType } = require("node-opcua-variant");
const { StatusCodes } = require("node-opcua-status-code");

(async () => {
  const server = new OPCUAServer({
    hostname: "127.0.0.1",
    port: Number(process.argv[2]),
    serverCertificateManager: new OPCUACertificateManager({
      rootFolder: process.argv[3], automaticallyAcceptUnknownCertificate: true,
    }),
    userManager: { isValidUser: (user, password) => user === "reader" && password === "test-only" },
  });
  await server.initialize();
  const space = server.engine.addressSpace;
  const own = space.getOwnNamespace();
  const room = own.addObject({ organizedBy: space.rootFolder.objects, browseName: "Room" });
  const T = own.addAnalogDataItem({
    componentOf: room, nodeId: "s=T", browseName: "T", dataType: "Double",
    engineeringUnitsRange: { low: -50, high: 100 },
    engineeringUnits: { namespaceUri: "", unitId: 4408652, displayName: { text: "°C" }, description: { text: "" } },
  });
  const broken = own.addVariable({ componentOf: room, nodeId: "s=broken", browseName: "broken", dataType: "Double" });
  space.installHistoricalDataNode(T, { maxOnlineValues: 1000 });
  const begin = 1767225600000;
  for (let minute = 0; minute < 30; minute++) {
    const value = new Variant({ dataType: DataType.Double, value: 20 + minute / 10 });
    T.setValueFromSource(value, StatusCodes.Good, new Date(begin + 60000 * minute));
  }
  setInterval(() => T.setValueFromSource(new Variant({ dataType: DataType.Double, value: 21 + Math.random() })), 100);
  broken.setValueFromSource(new Variant({ dataType: DataType.Double, value: 1 }), StatusCodes.BadSensorFailure);
  await server.start();
  console.log(JSON.stringify({ space: own.index }));
})();
