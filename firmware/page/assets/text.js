export {text} from "./en.js";
